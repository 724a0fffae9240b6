"""A place is announced when two attempts agree and the second has evidence that the first had not.

Two attempts in a row are weaker than they look: what chance arranged once is still there a step later. So the first
only names the place, as a rule by part of what is seen, and the second has to be acceptable with landmarks that had no
say in that. One attempt is enough where it has so much that three of its matches could be withheld and be the new ones.
"""

import math

from slam.pose import Pose2, wrap_rad
from slam.recognise.attempt import LEAST_MATCHES, Hypothesis

FIRST_ODDS = 3.0  # of a place that is named: twenty times as probable as all others and as none together
NEW_MATCHES = 3  # landmarks of the map that the first attempt did not have
CERTAIN_ODDS = 20.0  # without any three of its matches such an attempt would be acceptable as well
AGREE_M, AGREE_RAD = 2.0, 0.1  # between the two, after the rover's motion


class Confirmation:
    """Remembers the place that was named first, and by which landmarks of the map."""

    def __init__(self) -> None:
        self._map_from_frame: Pose2 | None = None
        self._known: set[int] = set()
        self._odds = -math.inf

    def add(self, hypothesis: Hypothesis, frame_from_body: Pose2) -> bool:
        """True when the place is confirmed. frame_from_body: where the rover was, in a frame that drifts slowly."""
        if hypothesis.odds < FIRST_ODDS:
            return False
        known = set(hypothesis.known.tolist())
        if hypothesis.acceptable and hypothesis.odds >= CERTAIN_ODDS and len(known) >= LEAST_MATCHES + NEW_MATCHES:
            return True
        if self._agrees(hypothesis, frame_from_body):
            if hypothesis.acceptable and len(known - self._known) >= NEW_MATCHES:
                return True
            if len(known) >= len(self._known):
                self._odds = max(self._odds, hypothesis.odds)
                return False
        elif hypothesis.odds < self._odds:
            return False
        self._map_from_frame = hypothesis.map_from_body @ frame_from_body.inverse()
        self._known, self._odds = known, max(self._odds, hypothesis.odds)
        return False

    def _agrees(self, hypothesis: Hypothesis, frame_from_body: Pose2) -> bool:
        if self._map_from_frame is None:
            return False
        off = (self._map_from_frame @ frame_from_body).inverse() @ hypothesis.map_from_body
        return math.hypot(off.x_m, off.y_m) < AGREE_M and abs(wrap_rad(off.heading_rad)) < AGREE_RAD
