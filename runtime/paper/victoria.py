"""Fig. 6 on real data: Victoria Park, a vehicle among trees, with GPS as its truth."""

import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.config import load_configuration
from runtime.importers.archive import Archive, load_archive
from runtime.importers.data_set import FAST_SPACING_NS, configuration_path
from runtime.importers.data_set_truth import truth_of
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.wheel_streams import wheel_samples
from runtime.paper.arms import arm_settings, merged
from runtime.paper.jobs import Result
from runtime.paper.trajectory_error import position_error, rigid_fit
from runtime.trajectory_files import composed, poses_at
from slam.estimator import Estimator
from slam.settings import SlamSettings

FloatArray = NDArray[np.float64]
SHARED = Path(__file__).parents[3] / "shared" / "data"
SHOWN_EVERY = 10


def data_folder() -> Path | None:
    """The recording beside the repository, None where it is not there."""
    folder = SHARED / "victoria_park"
    return folder if folder.is_dir() else None


@lru_cache(maxsize=1)
def _archive(folder: Path) -> Archive:
    return load_archive(folder)


def victoria_drive(
    seed: int,
    arm: str,
    particles: int,
    keep_paths: bool,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """Errors at the laser point against the good GPS fixes after a rigid fit, m; `code` as in feature_drive.

    The error in the frame of the start pose has the heading there from a fit of the first 100 m, as GPS has none.
    """
    folder = data_folder()
    if folder is None:
        raise FileNotFoundError(f"{SHARED / 'victoria_park'} is not there")
    archive = _archive(folder)
    configuration = load_configuration(configuration_path(archive))
    tree = merged(configuration.slam.model_dump(), merged(arm_settings(arm), {"particles": particles}))
    settings = SlamSettings.model_validate(tree)
    estimator = Estimator(settings, seed)
    rows: dict[str, list[tuple[float, ...]]] = {"published": [], "particles": [], "odometry": []}
    landmarks = 0
    likelihoods = 0.0
    map_m: FloatArray = np.empty((0, 2))
    began_s = time.process_time()
    for tick in ticks(seen(archive), wheel_samples(archive), FAST_SPACING_NS):
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        seconds = tick.stamp_ns * 1e-9
        poses = (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body)
        for name, pose in zip(rows, poses, strict=True):
            rows[name].append((seconds, pose.x_m, pose.y_m, pose.heading_rad))
        landmarks = int(estimate.counts["landmarks"])
        likelihoods += estimate.counts.get("likelihoods", 0.0)
        if estimate.landmarks is not None:
            map_m = estimate.landmarks.means_m
    spent_s = time.process_time() - began_s
    truth = truth_of(archive)
    if truth is None or truth.fixes is None:
        raise ValueError(f"{folder} has no GPS")
    mount = (settings.mount.x_m, settings.mount.y_m, settings.mount.yaw_rad)
    result: Result = {"landmarks": landmarks, "likelihoods": likelihoods, "cpu_s": spent_s}
    shown: dict[str, Any] = {}
    for name, path in rows.items():
        points = composed(poses_at(np.array(path), truth.fixes[:, 0]), mount)[:, :2]
        known = np.isfinite(points[:, 0])
        fixes = truth.fixes[known, 1:3]
        whole = rigid_fit(points[known], fixes)
        start = rigid_fit(points[known][_first_metres(fixes)], fixes[_first_metres(fixes)])
        fitted = position_error(whole.transform(points[known]), fixes)
        result[f"{name}_aligned_trimmed_rms_m"] = fitted.trimmed_rms_m
        result[f"{name}_from_start_trimmed_rms_m"] = position_error(start.transform(points[known]), fixes).trimmed_rms_m
        shown[name] = np.round(whole.transform(points[known])[::SHOWN_EVERY], 2).tolist()
        shown["truth"] = np.round(fixes[::SHOWN_EVERY], 2).tolist()
        if name == "published":
            result["map_m"] = np.round(whole.transform(map_m), 2).tolist()
    if not keep_paths:
        result.pop("map_m")
        return result
    return {**result, "paths": shown}


def _first_metres(fixes: FloatArray) -> NDArray[np.bool_]:
    """The first 100 m of the way, where drift is small and the heading can be told."""
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(fixes, axis=0).T))))
    first: NDArray[np.bool_] = driven <= 100.0
    return first
