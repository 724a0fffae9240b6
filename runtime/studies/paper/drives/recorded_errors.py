"""How far the poses of a recorded drive are from its truth: GPS fixes, motion capture, or verified relations."""

from typing import Any

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from runtime.evaluate.against_truth import at_laser, relation_error
from runtime.evaluate.errors import in_start_frame, position_error, rigid_fit, squared_pose_errors, trajectory_error
from runtime.evaluate.rows import poses_at
from runtime.evaluate.truth import NO_OFFSET, DataSetTruth, Mount
from runtime.studies.jobs import Result
from slam.pose import composed

SHOWN_EVERY = 10
START_M = 100.0


def figures_against(
    truth: DataSetTruth, paths: dict[str, FloatArray], covariances: FloatArray, body_from_laser: Mount
) -> Result:
    """Errors of paths (n, 4) of t s, x m, y m, heading rad by whatever truth there is.

    All are of the laser point, as runtime.evaluate has them. NEES of the published pose: where laser and body are one.
    """
    result: Result = {}
    for name, path in paths.items():
        if truth.fixes is not None:
            figures = _fixes(truth.fixes, path, body_from_laser)
            result |= {f"{name}_{figure}": value for figure, value in figures.items()}
        elif truth.poses is not None:
            figures = _poses(truth.poses, at_laser(path, body_from_laser))
            result |= {f"{name}_{figure}": value for figure, value in figures.items()}
        if truth.relations is not None:
            relations, _ = relation_error(at_laser(path, body_from_laser), truth.relations)
            result[f"{name}_relation_translation_m"] = None if relations is None else relations.translation_m
            result[f"{name}_relation_rotation_deg"] = None if relations is None else relations.rotation_deg
    if truth.poses is not None and body_from_laser == NO_OFFSET:
        result["nees_median"] = _median_nees(truth.poses, paths["published"], covariances)
    return result


def shown_paths(
    truth: DataSetTruth, paths: dict[str, FloatArray], map_m: FloatArray, body_from_laser: Mount
) -> dict[str, Any]:
    """Every tenth position of all paths and of the truth, rigidly fitted, for a picture; nothing without positions."""
    reference = truth.fixes if truth.fixes is not None else truth.poses
    if reference is None:
        return {}
    result: dict[str, Any] = {}
    shown: dict[str, Any] = {}
    for name, path in paths.items():
        points = composed(poses_at(path, reference[:, 0]), np.array(body_from_laser))[:, :2]
        known = np.isfinite(points[:, 0])
        whole = rigid_fit(points[known], reference[known, 1:3])
        shown[name] = np.round(whole.transform(points[known])[::SHOWN_EVERY], 2).tolist()
        shown["truth"] = np.round(reference[known, 1:3][::SHOWN_EVERY], 2).tolist()
        if name == "published":
            result["map_m"] = np.round(whole.transform(map_m), 2).tolist()
    return {**result, "paths": shown}


def _fixes(fixes: FloatArray, path: FloatArray, body_from_laser: Mount) -> Result:
    """After the rigid fit of all fixes, and with the start's heading from a fit of the first 100 m: GPS has none."""
    points = composed(poses_at(path, fixes[:, 0]), np.array(body_from_laser))[:, :2]
    known = np.isfinite(points[:, 0])
    points, places = points[known], fixes[known, 1:3]
    first = _first_metres(places)
    start = rigid_fit(points[first], places[first])
    return {
        "aligned_trimmed_rms_m": position_error(rigid_fit(points, places).transform(points), places).trimmed_rms_m,
        "from_start_trimmed_rms_m": position_error(start.transform(points), places).trimmed_rms_m,
    }


def _poses(poses: FloatArray, path: FloatArray) -> Result:
    """In the frame of the start pose, and after the rigid fit."""
    true = poses_at(poses, path[:, 0])
    known = np.isfinite(true[:, 0])
    error = trajectory_error(path[known, 1:], true[known])
    return {
        "largest_m": error.from_start.largest_m,
        "rms_m": error.from_start.rms_m,
        "aligned_largest_m": error.aligned.largest_m,
        "aligned_rms_m": error.aligned.rms_m,
    }


def _median_nees(poses: FloatArray, path: FloatArray, covariances: FloatArray) -> float:
    """Of the whole pose (3 degrees of freedom), in the frame of the start pose."""
    true = poses_at(poses, path[:, 0])
    known = np.isfinite(true[:, 0])
    values = squared_pose_errors(in_start_frame(path[known, 1:]), covariances[known], in_start_frame(true[known]))
    return float(np.nanmedian(values))


def _first_metres(places: FloatArray) -> BoolArray:
    """The first 100 m of the way, where drift is small and the heading can be told."""
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))))
    first: BoolArray = driven <= START_M
    return first
