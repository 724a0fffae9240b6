"""Techniques 1 and 2 at the level of features, for worlds whose sensor already tells things apart.

Difference: a feature may create a landmark only when at least half of the last scans, compensated for the rover's
motion, saw something there too. Sparse: of two features nearer than the spacing the nearer to the sensor is kept.
"""

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.front_end.spacing import spaced
from slam.observations import Features
from slam.pose import Pose2

SCANS, SHARE = 5, 0.5  # the vote that won when the method was tried
FOUND_M = 0.7  # ours: noise at 25 m is 0.45 m across, a walker gets 1.4 m further in five scans
SPACING_M = 0.75  # ours: second returns stand 0.5 m beside their landmark


class FeatureVote:
    """Remembers where earlier scans saw something, in the odometry's frame."""

    def __init__(self, *, difference: bool, sparse: bool) -> None:
        self._difference = difference
        self._sparse = sparse
        self._seen: deque[FloatArray] = deque(maxlen=SCANS)

    def __call__(self, features: Features, odom_from_body: Pose2) -> Features:
        """The features that are kept, with their licences."""
        if self._sparse and len(features):
            features = _rows(features, spaced(_points(features), np.argsort(features.ranges_m), SPACING_M))
        points = odom_from_body.transform(_points(features))
        if self._difference and self._seen:
            votes = np.zeros(len(features))
            for seen in self._seen:
                if len(seen) and len(points):
                    distances = np.hypot(*(points[:, np.newaxis] - seen).transpose(2, 0, 1))
                    votes += distances.min(axis=1) < FOUND_M
            features = replace(features, may_create=votes >= SHARE * len(self._seen))
        self._seen.append(points)
        return features


def _points(features: Features) -> FloatArray:
    ranges, bearings = features.ranges_m, features.bearings_rad
    return np.stack((ranges * np.cos(bearings), ranges * np.sin(bearings)), axis=-1)


def _rows(features: Features, kept: NDArray[np.bool_]) -> Features:
    return Features(
        features.stamp_ns,
        features.ranges_m[kept],
        features.bearings_rad[kept],
        features.covariances[kept],
        features.may_create[kept],
        features.identities[kept],
        features.beams[kept],
    )
