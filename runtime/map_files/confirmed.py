"""Which landmarks are believed to stand there."""

import numpy as np

from slam.estimate import LandmarkMap

CONFIRMED_LOG_ODDS = 3.0
"""As slam.joint.gaussian has it, which tests hold it to: to import that loads a compiler, 45 MB for one number."""


def confirmed(landmarks: LandmarkMap | None) -> LandmarkMap:
    """Those that the filter would keep out of sight; others may be a chance point or somebody's legs."""
    if landmarks is None:
        return LandmarkMap(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    kept = landmarks.existence_log_odds >= CONFIRMED_LOG_ODDS
    return LandmarkMap(
        landmarks.identities[kept],
        landmarks.means_m[kept],
        landmarks.covariances_m2[kept],
        landmarks.existence_log_odds[kept],
    )
