"""Small scenes that several tests of the filter share."""

import math
from typing import Any

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.observations import FeatureRows, Features, usable_rows
from slam.odometry.odometry import Increment
from slam.pose import wrap_rads
from slam.settings.slam import SlamSettings

POSTS_M = np.array(((6.0, 2.0), (8.0, -3.0), (3.0, 5.0), (12.0, 1.0), (5.0, -6.0), (15.0, 8.0)))


def settings_of(**changes: Any) -> SlamSettings:
    """Settings for features that are given, with speed and yaw rate as wheels."""
    tree: dict[str, Any] = {
        "particles": 20,
        "odometry": {"model": "speed_yaw_rate"},
        "front_end": {"kind": "given", "sigma_range_m": 0.05, "sigma_bearing_rad": 0.01},
    }
    return SlamSettings.model_validate(tree | changes)


def seen_from(
    pose: FloatArray,
    points_m: FloatArray,
    identities: IntArray | None = None,
    may_create: bool = True,
    range_max_m: float = 30.0,
) -> FeatureRows:
    """Exact features of points (K, 2) from a pose (3,) whose laser stands at the body's origin."""
    gaps = points_m - pose[:2]
    count = len(points_m)
    features = Features(
        0,
        np.hypot(gaps[:, 0], gaps[:, 1]),
        wrap_rads(np.arctan2(gaps[:, 1], gaps[:, 0]) - pose[2]),
        np.tile(np.diag((0.05**2, 0.01**2)), (count, 1, 1)),
        np.full(count, may_create),
        np.full(count, -1) if identities is None else identities,
        np.full(count, -1),
    )
    return usable_rows(features, range_max_m, 0.0)


def increment_of(x: float = 0.0, y: float = 0.0, heading: float = 0.0, sigma: float = 0.0) -> Increment:
    """An increment with standard deviation sigma m sideways and ahead, and sigma / 5 rad."""
    covariance = np.diag((sigma**2, sigma**2, (0.2 * sigma) ** 2))
    still = x == 0.0 and y == 0.0 and heading == 0.0 and sigma == 0.0
    mean, speeds = np.array((x, y, heading)), (10.0 * x, 10.0 * y, 10.0 * heading)
    return Increment(mean, covariance, still, True, 0.1, *speeds, 0.0 if still else 0.1)


def arc_pose(pose: FloatArray, distance: float, turn: float) -> FloatArray:
    """Pose (3,) after an arc."""
    half = pose[2] + 0.5 * turn
    chord = distance * (math.sin(0.5 * turn) / (0.5 * turn) if turn else 1.0)
    return np.array((pose[0] + chord * math.cos(half), pose[1] + chord * math.sin(half), pose[2] + turn))
