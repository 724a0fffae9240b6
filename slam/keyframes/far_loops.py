"""Closes loops where the pose is known to metres only: believed when two keyframes, found a way apart, say the same."""

import math

from drivers.measurements import FloatArray
from slam.arithmetic.small_matrices import inverse
from slam.front_end.wide_search import Found, WideSearch
from slam.keyframes.agreement import Agreement, correction_of
from slam.pose import Pose2

STEP_M = 0.25  # between two searches, each of which takes milliseconds
LEAST_SHARE = 0.25  # of the points on surfaces of the keyframe: by a tenth corridors were closed metres off
CLEAR_M = 0.3  # sigma of a fit; one that leaves more open, as in a corridor, does not say where the rover is


class FarLoops:
    """Lays scans onto keyframes metres away."""

    def __init__(self) -> None:
        self._tried_at: Pose2 | None = None
        self._agreement = Agreement()

    def is_due(self, pose: Pose2) -> bool:
        """Whether the rover has moved on since the last search."""
        if self._tried_at is None:
            return True
        return math.hypot(pose.x_m - self._tried_at.x_m, pose.y_m - self._tried_at.y_m) >= STEP_M

    def find(self, number: int, search: WideSearch, at: FloatArray, pose: Pose2, predicted: FloatArray) -> Found | None:
        """The motion from a keyframe to the body; None until two keyframes have said the same: rooms look alike.

        number: of the keyframe. search: for the scan on it. predicted (3,): where the body at pose should be, as seen
        from the keyframe; at (3,): where it is looked for.
        """
        self._tried_at = pose
        found = search.nearby(at)
        if found is None or found.share < LEAST_SHARE:
            return None
        if math.sqrt(inverse(found.information)[:2, :2].trace()) > CLEAR_M:
            return None
        correction = correction_of(pose, Pose2(*predicted.tolist()), Pose2(*found.motion.tolist()))
        return found if self._agreement.confirms(number, correction, pose) else None
