import math

import numpy as np

from slam.joint import JointGaussian
from slam.joint_settings import JointSettings
from slam.observations import Features, MatchVerdict
from slam.pose import Pose2

STILL = (np.zeros(3), np.zeros((3, 3)))
NOISE = np.diag((0.1**2, math.radians(1.0) ** 2))


def features_at(points: list[tuple[float, float]], identities: list[int] | None = None) -> Features:
    """Features of points in the laser's frame, free of noise."""
    array = np.array(points, dtype=np.float64).reshape(-1, 2)
    count = len(array)
    return Features(
        0,
        np.hypot(array[:, 0], array[:, 1]),
        np.arctan2(array[:, 1], array[:, 0]),
        np.tile(NOISE, (count, 1, 1)),
        np.ones(count, dtype=np.bool_),
        np.full(count, -1, dtype=np.int64) if identities is None else np.array(identities, dtype=np.int64),
        np.full(count, -1, dtype=np.int64),
    )


def unknown(features: Features) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.full(len(features), -1, dtype=np.int64)


def test_a_landmark_seen_twice_is_one_landmark() -> None:
    joint = JointGaussian(JointSettings(), Pose2())
    seen = features_at([(10.0, 2.0), (5.0, -8.0)])
    assert (joint.step(*STILL, seen, unknown(seen)) == int(MatchVerdict.NEW)).all()
    assert (joint.step(*STILL, seen, unknown(seen)) >= 0).all()
    assert joint.landmark_count == 2
