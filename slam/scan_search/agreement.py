"""A place is believed when stretches of the way, each with scans of its own, agree on it for long enough.

Each stretch is new evidence, so that the odds add up; a stretch that lies better elsewhere takes its own away.
"""

import math
from dataclasses import replace

from slam.pose import Pose2, wrap_rad
from slam.recognise.attempt import ODDS
from slam.scan_search.laying import Laid

MOST_OF_ONE = ODDS / 2.0  # that one stretch is believed to say: at least two have to agree
AGREE_M, AGREE_RAD = 1.0, 0.1  # between two places, after the rover's motion


class Agreement:
    """What the stretches say of one map. odds: of the place that they agree on."""

    def __init__(self) -> None:
        self.odds = 0.0
        self._map_from_frame: Pose2 | None = None

    def add(self, laid: Laid, frame_from_body: Pose2) -> Laid | None:
        """The place with the odds of all stretches, once it is believed. frame_from_body: where the rover was in a
        frame that drifts slowly.
        """
        odds = min(laid.odds, MOST_OF_ONE)
        if not odds > 0.0:
            return None
        if self._agrees(laid, frame_from_body):
            self.odds += odds
        elif self.odds < 2.0 * odds:
            self.odds = odds
        else:
            self.odds -= odds
            return None
        self._map_from_frame = laid.map_from_body @ frame_from_body.inverse()
        return replace(laid, odds=self.odds) if self.odds >= ODDS else None

    def _agrees(self, laid: Laid, frame_from_body: Pose2) -> bool:
        if self._map_from_frame is None:
            return False
        off = (self._map_from_frame @ frame_from_body).inverse() @ laid.map_from_body
        return math.hypot(off.x_m, off.y_m) < AGREE_M and abs(wrap_rad(off.heading_rad)) < AGREE_RAD
