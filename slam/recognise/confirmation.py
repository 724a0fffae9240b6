"""A place is announced when two attempts agree and the second has evidence that the first had not.

Two attempts in a row are weaker than they look: what chance arranged once is still there a step later. The first may
have been one on a part of what is seen: what was withheld from it is new as well. One attempt is enough where it has
so much that three of its matches could be withheld and be the new ones.
"""

import math

from slam.pose import Pose2, wrap_rad
from slam.recognise.attempt import LEAST_MATCHES, Hypothesis

NEW_MATCHES = 3  # landmarks of the map that the first attempt did not have
CERTAIN_ODDS = 20.0  # without any three of its matches such an attempt would be acceptable as well
AGREE_M, AGREE_RAD = 2.0, 0.1  # between the two, after the rover's motion


class Confirmation:
    """Remembers the first acceptable hypothesis."""

    def __init__(self) -> None:
        self._map_from_frame: Pose2 | None = None
        self._known: set[int] = set()

    def add(self, hypothesis: Hypothesis, frame_from_body: Pose2) -> bool:
        """True when the place is confirmed. frame_from_body: where the rover was, in a frame that drifts slowly."""
        if not hypothesis.acceptable:
            return False
        known = set(hypothesis.known.tolist())
        if hypothesis.odds >= CERTAIN_ODDS and len(known) >= LEAST_MATCHES + NEW_MATCHES:
            return True
        if self._map_from_frame is not None:
            expected = self._map_from_frame @ frame_from_body
            off = expected.inverse() @ hypothesis.map_from_body
            if math.hypot(off.x_m, off.y_m) < AGREE_M and abs(wrap_rad(off.heading_rad)) < AGREE_RAD:
                if len(known - self._known) >= NEW_MATCHES:
                    return True
                if len(known) >= len(self._known):
                    return False
        self._map_from_frame = hypothesis.map_from_body @ frame_from_body.inverse()
        self._known = known
        return False
