"""SLAM and feature detection on the simulated outdoor drive (Fig. 5 and 6)."""

import time
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.evaluate.errors import in_start_frame, squared_pose_errors
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.arms import arm_settings, merged
from runtime.studies.paper.drives.outcome import joined, path_figures
from runtime.studies.paper.drives.outdoor import OutdoorStep, mounted, outdoor_steps, world_settings
from slam.estimate import Estimate
from slam.estimator import Estimator
from slam.observations import BeamVerdict
from slam.settings.slam import SlamSettings


def outdoor_drive(
    seed: int,
    arm: str,
    particles: int,
    duration_s: float,
    keep_paths: bool,
    code: str,  # noqa: ARG001  names the job
    front_end: str = "robust",
) -> Result:
    """Figures of one drive; `code` as in feature_drive.

    front_end "paper": differencing and range extrema as printed, with a noise that suits them (ours).
    """
    mount = world_settings(seed).laser.body_from_laser
    changes: dict[str, Any] = {"particles": particles, "mount": {"x_m": mount[0]}}
    if front_end == "paper":
        changes["front_end"] = {"kind": "paper", "sigma_range_floor_m": 0.1, "sigma_bearing_floor_rad": 0.01}
    settings = SlamSettings.model_validate(merged(changes, arm_settings(arm)))
    steps = outdoor_steps(seed, duration_s)
    estimator = Estimator(settings, seed, map_every=1)
    estimates = []
    began_s = time.process_time()
    likelihoods = 0.0
    for step in steps:
        estimate = estimator.step(step.scan.stamp_ns, step.scan, step.wheels)
        likelihoods += estimate.counts["likelihoods"]
        estimates.append(estimate)
    spent_s = time.process_time() - began_s
    truth = in_start_frame(np.array([step.truth for step in steps]))
    paths = {
        "particles": np.array([estimate.particle_mean.as_array() for estimate in estimates]),
        "published": np.array([estimate.map_from_body.as_array() for estimate in estimates]),
        "odometry": np.array([estimate.odom_from_body.as_array() for estimate in estimates]),
    }
    nees = squared_pose_errors(paths["published"].copy(), np.array([e.covariance for e in estimates]), truth)
    result: Result = {
        "landmarks": int(estimates[-1].counts["landmarks"]),
        "likelihoods": likelihoods,
        "cpu_s": spent_s,
        "nees_median": float(np.nanmedian(nees)),
        "not_finite": int(sum((~np.isfinite(path)).sum() for path in paths.values())),
        **feature_figures(steps, estimates),
        **path_figures(paths, truth),
    }
    if keep_paths:
        last = estimates[-1].landmarks
        result["paths"] = joined(paths, truth)
        result["map_m"] = [] if last is None else np.round(last.means_m, 3).tolist()
        result["scan"] = scan_picture(steps, estimates, mount)
    return result


def feature_figures(steps: tuple[OutdoorStep, ...], estimates: list[Estimate]) -> dict[str, float]:
    """What Fig. 5 claims, counted over the whole drive while the rover moves (shares of 1).

    moving_features_share: features that lie on people or robots; moving_created_share: of those that may create a
    landmark; moving_beams_removed: beams on them that differencing marked; fixed_beams_removed: beams on what stands.
    least_spacing_m: smallest distance of two features of one scan.
    """
    counts = np.zeros(8)
    least_m = np.inf
    for step, estimate in zip(steps, estimates, strict=True):
        features, verdicts = estimate.features, estimate.beam_verdicts
        if features is None or verdicts is None or estimate.counts["at_rest"]:
            continue
        moving = step.moving[features.beams]
        licensed = features.may_create
        hit = np.isfinite(step.scan.ranges_m)
        marked = verdicts == BeamVerdict.MOVED
        counts += (
            len(moving),
            moving.sum(),
            licensed.sum(),
            (moving & licensed).sum(),
            (hit & step.moving).sum(),
            (hit & step.moving & marked).sum(),
            (hit & ~step.moving).sum(),
            (hit & ~step.moving & marked).sum(),
        )
        least_m = min(least_m, _least_spacing_m(features.ranges_m, features.bearings_rad))
    features_n, on_moving, may_create, creating, beams, removed, fixed, fixed_removed = counts
    return {
        "features_per_scan": features_n / len(steps),
        "moving_features_share": on_moving / max(features_n, 1.0),
        "moving_created_share": creating / max(may_create, 1.0),
        "moving_beams_removed": removed / max(beams, 1.0),
        "fixed_beams_removed": fixed_removed / max(fixed, 1.0),
        "least_spacing_m": float(least_m) if np.isfinite(least_m) else -1.0,
    }


def scan_picture(
    steps: tuple[OutdoorStep, ...], estimates: list[Estimate], mount: tuple[float, float, float]
) -> dict[str, Any]:
    """One scan among many movers, as Fig. 5 shows it, in the true map frame.

    Of the scans with at least half as many beams on movers within 12 m as any, the one with the median number of
    features that may become landmarks: neither the best nor the worst.
    """
    first = len(steps) // 5
    near = np.array([(step.moving & (step.scan.ranges_m < 12.0)).sum() for step in steps[first:]])
    crowded = first + np.flatnonzero(2 * near >= near.max())
    licensed = [0 if (seen := estimates[k].features) is None else int(seen.may_create.sum()) for k in crowded]
    index = int(crowded[np.argsort(licensed, kind="stable")[len(licensed) // 2]])
    step, estimate = steps[index], estimates[index]
    features, verdicts = estimate.features, estimate.beam_verdicts
    if features is None or verdicts is None:
        raise ValueError("the tick has a scan, so it has features")
    x, y, heading = mounted(step.truth, mount)
    hit = np.isfinite(step.scan.ranges_m)

    def in_map(ranges: FloatArray, bearings: FloatArray) -> list[list[float]]:
        angles = bearings + heading
        return np.round(np.column_stack((x + ranges * np.cos(angles), y + ranges * np.sin(angles))), 3).tolist()  # type: ignore[no-any-return]

    return {
        "robot_m": [x, y, heading],
        "seconds": step.scan.stamp_ns * 1e-9,
        "points_m": in_map(step.scan.ranges_m[hit].astype(np.float64), step.scan.bearings_rad[hit]),
        "moving": step.moving[hit].astype(int).tolist(),
        "removed": (verdicts[hit] == BeamVerdict.MOVED).astype(int).tolist(),
        "features_m": in_map(features.ranges_m, features.bearings_rad),
        "features_may_create": features.may_create.astype(int).tolist(),
        "features_moving": step.moving[features.beams].astype(int).tolist(),
    }


def _least_spacing_m(ranges_m: FloatArray, bearings_rad: FloatArray) -> float:
    if len(ranges_m) < 2:
        return float("inf")
    points = np.stack((ranges_m * np.cos(bearings_rad), ranges_m * np.sin(bearings_rad)), axis=-1)
    distances = np.hypot(*(points[:, np.newaxis] - points).transpose(2, 0, 1))
    return float(distances[np.triu_indices(len(points), 1)].min())
