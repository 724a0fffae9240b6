"""One drive through a world at feature level: the particles, and the joint Gaussian beside them, with CPU times."""

import math
import time
from functools import lru_cache
from typing import Any

import numpy as np

from runtime.evaluate.errors import in_start_frame, squared_pose_errors
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.arms import NORMAL, arm_settings, merged
from runtime.studies.paper.drives.feature_vote import FeatureVote
from runtime.studies.paper.drives.outcome import joined, path_figures
from runtime.studies.paper.drives.worlds import (
    BEARING_NOISE_RAD,
    PERIOD_S,
    RANGE_NOISE_M,
    SPEED_NOISE_MPS,
    VIEW_M,
    YAW_RATE_NOISE_RADPS,
    FeatureDrive,
    WorldKind,
    feature_world,
)
from slam.front_end.deskew import Twist
from slam.front_end.front_ends import GivenFrontEnd
from slam.joint.gaussian import JointGaussian
from slam.observations import usable_rows
from slam.odometry.odometry import Odometry
from slam.particles.fastslam import FastSlam
from slam.particles.step import landmarks_near
from slam.settings.slam import SlamSettings
from slam.visibility import field_of_view

WHOLE_MAP_M = 500.0
SIGHT = field_of_view(VIEW_M - 2.0, math.radians(130.0))

WORLD_SETTINGS: dict[str, Any] = {
    "odometry": {
        "model": "speed_yaw_rate",
        "speed_noise_mps": SPEED_NOISE_MPS,
        "yaw_rate_noise_radps": YAW_RATE_NOISE_RADPS,
        "noise_time_s": PERIOD_S,
    },
    "front_end": {"kind": "given", "sigma_range_m": RANGE_NOISE_M, "sigma_bearing_rad": BEARING_NOISE_RAD},
    "view": {"range_max_m": VIEW_M + 1.0},
}


def feature_settings(arm: str, particles: int) -> SlamSettings:
    """The noise of the world as it is, all else by default, and what the arm changes."""
    tree = merged(merged(WORLD_SETTINGS, arm_settings(arm)), {"particles": particles})
    return SlamSettings.model_validate(tree)


@lru_cache(maxsize=2)
def _world(kind: WorldKind, seed: int, scans_at_rest: int) -> FeatureDrive:
    return feature_world(kind, seed, scans_at_rest)


def feature_drive(
    kind: WorldKind,
    seed: int,
    arm: str,
    particles: int,
    keep_paths: bool,
    code: str,  # noqa: ARG001  names the job
    steps: int | None = None,
) -> Result:
    """Figures of one drive, and with `keep_paths` its paths and maps.

    code: hash of the sources, so that a changed method is another job. steps: only the first so many. Normal
    estimation has no joint Gaussian: the paper publishes the particles' mean.
    """
    drive, settings = _world(kind, seed, 10), feature_settings(arm, particles)
    wanted = drive.steps[:steps]
    truth = in_start_frame(drive.truth[: len(wanted)])
    particles_cpu_s = joint_cpu_s = 0.0
    likelihoods = 0
    filter_, odometry = FastSlam(settings, np.random.default_rng(seed)), Odometry(settings.odometry)
    joint = None if arm == NORMAL else JointGaussian(settings.joint, settings.mount.as_pose(), settings.tuning())
    front_end = GivenFrontEnd(settings.front_end)
    vote = FeatureVote(difference=settings.techniques.difference, sparse=settings.techniques.sparse)
    means, published, covariances, dead_reckoned = [], [], [], []
    for step in wanted:
        odometry.add(step.wheels)
        increment = odometry.take_until(step.stamp_ns)
        features, _ = front_end.observe(step.sightings, odometry.odom_from_body, Twist(), increment.at_rest)
        features = vote(features, odometry.odom_from_body)
        began_s = time.process_time()
        rows = usable_rows(features, settings.view.range_max_m, settings.mount.yaw_rad)
        outcome = filter_.step(increment, rows, SIGHT)
        between_s = time.process_time()
        if joint is not None:
            joint.step(increment.mean, increment.covariance, rows, outcome.matches, SIGHT)
            published.append(joint.map_from_body.as_array())
            covariances.append(joint.covariance)
        joint_cpu_s += time.process_time() - between_s
        particles_cpu_s += between_s - began_s
        likelihoods += outcome.likelihoods
        means.append(filter_.mean()[0].as_array())
        dead_reckoned.append(odometry.odom_from_body.as_array())
    paths = {"particles": np.array(means), "odometry": np.array(dead_reckoned)}
    nees = float("nan")
    if joint is not None:
        paths["published"] = np.array(published)
        nees = float(np.nanmedian(squared_pose_errors(np.array(published), np.array(covariances), truth)))
    count, in_view = filter_.store.count_of(filter_.best), int(drive.ever_in_view.sum())
    result: Result = {
        "landmarks": int(count),
        "landmarks_in_view": in_view,
        "landmarks_ratio": count / in_view,
        "landmarks_published_ratio": None if joint is None else joint.landmark_count / in_view,
        "not_finite": int(sum((~np.isfinite(path)).sum() for path in paths.values())),
        "landmarks_published": None if joint is None else int(joint.landmark_count),
        "likelihoods": likelihoods,
        "filter_cpu_s": particles_cpu_s,
        "joint_cpu_s": None if joint is None else joint_cpu_s,
        "nees_median": nees if math.isfinite(nees) else None,
        **path_figures(paths, truth),
    }
    if keep_paths:
        x_m, y_m = (float(value) for value in filter_.poses[filter_.best, :2])
        numbers, _ = landmarks_near(filter_.store.pages, filter_.best, filter_.store.cell_m, x_m, y_m, WHOLE_MAP_M)
        true = drive.landmarks_m[drive.ever_in_view]
        start = drive.steps[0].truth.inverse()
        result |= {
            "paths": joined(paths, truth),
            "seconds": [round(step.stamp_ns * 1e-9, 3) for step in wanted],
            "map_m": np.round(numbers[:, :2], 3).tolist(),
            "published_map_m": [] if joint is None else np.round(joint.landmarks().means_m, 3).tolist(),
            "true_landmarks_m": np.round(start.transform(true), 3).tolist(),
        }
    return result
