"""What a pose is worth in one place: its errors, whether its quality told the truth, how crisp its map is."""

from collections.abc import Iterable, Sequence

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike
from runtime.evaluate.against_truth import PathError, compare_with_truth
from runtime.evaluate.errors import LEAST_FIT_POINTS, rigid_fit
from runtime.evaluate.rows import poses_at
from runtime.evaluate.truth import DataSetTruth, Mount
from runtime.studies.jobs import Result
from runtime.studies.places.drive import Driven
from slam.estimate import Quality
from slam.pose import composed

RIGHT_M = 1.0
SIGMAS = 3.0
TRUTH_M = 0.1  # sigma of the truth itself: no pose fixes the frame better than that
CELL_M = 0.05


def truth_figures(drive: Driven, truth: DataSetTruth, mount: Mount) -> Result:
    """Errors of published pose and odometry at every time of the truth, their ratio, and false qualities.

    Only what the truth can tell is there. The ratio is that of the relations where the set has them.
    """
    comparison = compare_with_truth(drive.published, drive.odometry, truth, mount)
    result = _errors("published", comparison.published) | _errors("odometry", comparison.odometry)
    if comparison.over_odometry is not None:
        result["over_odometry"] = comparison.over_odometry
    places = truth.fixes if truth.fixes is not None else truth.poses
    if places is not None:
        result |= _quality_against(drive, places, truth.point(mount))
    return result


def quality_shares(errors_m: FloatArray, sigma_m: FloatArray, qualities: Sequence[Quality]) -> dict[str, float]:
    """Shares of the moments (n,) with a wrong quality, errors and published sigma in m.

    false_lost: called lost though the error is below 1 m and below 3 sigma. false_tracking: called tracking though the
    error is beyond both.
    """
    right = (errors_m < RIGHT_M) & (errors_m < SIGMAS * sigma_m)
    wrong = (errors_m > RIGHT_M) & (errors_m > SIGMAS * sigma_m)
    lost = np.array([quality is Quality.LOST for quality in qualities])
    tracking = np.array([quality is Quality.TRACKING for quality in qualities])
    return {"false_lost": float((right & lost).mean()), "false_tracking": float((wrong & tracking).mean())}


def occupied_cells(scans: Iterable[ScanLike], path: FloatArray, mount: Mount) -> int:
    """Cells of 5 cm that hold a return when every scan is drawn from its pose on the path (n, 4): fewer are crisper."""
    seen = [scan for scan in scans if isinstance(scan, Scan)]
    poses = composed(poses_at(path, np.array([scan.stamp_ns * 1e-9 for scan in seen])), np.array(mount))
    cells = [np.empty((0, 2), dtype=np.int64)]
    for scan, (x, y, heading) in zip(seen, poses, strict=True):
        if np.isfinite(x):
            hit = np.isfinite(scan.ranges_m)
            angle, ranges = scan.bearings_rad[hit] + heading, scan.ranges_m[hit]
            points = np.column_stack((x + ranges * np.cos(angle), y + ranges * np.sin(angle)))
            cells.append(np.unique(np.floor(points / CELL_M).astype(np.int64), axis=0))
    return len(np.unique(np.concatenate(cells), axis=0))


def _errors(name: str, error: PathError) -> Result:
    result: Result = {}
    if error.position is not None:
        result[f"{name}_rms_m"] = error.position.rms_m
        result[f"{name}_trimmed_rms_m"] = error.position.trimmed_rms_m
    if error.relation is not None:
        result[f"{name}_relation_m"] = error.relation.translation_m
        result[f"{name}_relation_deg"] = error.relation.rotation_deg
    return result


def _quality_against(drive: Driven, places: FloatArray, point: Mount) -> dict[str, float]:
    """At every tick between two places: its quality and sigma, and the error in the frame of the map.

    A covariance says how far the pose is off in that frame, which the poses define that are known best: each counts in
    the fit by its own. What was in another map than most, a new one that began on unknown ground, is in another frame
    and left out. The error is known at the times of the places and linear between them: scans may come seconds apart,
    and a quality that doubts itself from scan to scan would be seen only at its best.
    """
    numbers, ticks = np.unique(drive.maps, return_counts=True)
    in_map = drive.maps == numbers[np.argmax(ticks)]
    points = composed(poses_at(drive.published, places[:, 0]), np.array(point))[:, :2]
    at = np.minimum(np.searchsorted(drive.published[:, 0], places[:, 0]), len(in_map) - 1)
    known = np.isfinite(points[:, 0]) & in_map[at]
    if known.sum() < LEAST_FIT_POINTS:
        return {}
    points, onto, sigma_m = points[known], places[known, 1:3], drive.sigma_m[at[known]]
    misses_m = rigid_fit(points, onto, 1.0 / (sigma_m**2 + TRUTH_M**2)).transform(points) - onto
    misses = np.column_stack((places[known, 0], misses_m, np.zeros(len(misses_m))))
    errors_m = np.hypot(*poses_at(misses, drive.published[:, 0])[:, :2].T)
    between = np.flatnonzero(np.isfinite(errors_m) & in_map)
    if not len(between):
        return {}
    return quality_shares(errors_m[between], drive.sigma_m[between], [drive.qualities[tick] for tick in between])
