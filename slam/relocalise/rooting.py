"""Which landmarks are rooted: made while what was seen before was still in view.

After a slip into unmapped country nothing is missed, and the same things are mapped a second time. What was made since
the rover last saw enough of the rooted map is a stretch of its own until that is in view again, or is recognised.
"""

import numpy as np

from drivers.measurements import BoolArray, IntArray
from slam.observations import IDENTITIES_PER_SCAN

LEAST_ROOTED, LEAST_SHARE, IN_A_ROW = 3, 0.75, 3  # weaker rules root what chance matches hold after a slip
FIRST_LANDMARKS = 12  # up to so many, all that is made belongs to the beginning of the map


class Rooting:
    """before_scan: landmarks that were made before this scan are rooted. keyframes: how many of them there were."""

    def __init__(self, before_scan: int = 0) -> None:
        self.before_scan = before_scan
        self.keyframes = 0
        self._in_a_row = 0
        self._is_empty = before_scan == 0  # no landmark is rooted

    def add(self, scan: int, matched: IntArray, landmarks: int, keyframes: int) -> bool:
        """What one scan, the last before this number, matched: identities or verdicts (K,). landmarks: in the map.

        True where all that there is is rooted.
        """
        matched = matched[matched >= 0]
        rooted = int((matched < self.before_scan * IDENTITIES_PER_SCAN).sum())
        supported = rooted >= LEAST_ROOTED and rooted >= LEAST_SHARE * len(matched)
        self._in_a_row = self._in_a_row + 1 if supported else 0
        is_beginning = self._is_empty or landmarks <= FIRST_LANDMARKS
        is_rooted = self._in_a_row >= IN_A_ROW or is_beginning
        if is_rooted:
            self.root(scan, keyframes)
            self._is_empty = landmarks == 0
        return is_rooted

    def root(self, scan: int, keyframes: int) -> None:
        """All that was made before this scan belongs to the map."""
        self.before_scan, self.keyframes = scan, keyframes
        self._is_empty = False

    def is_rooted(self, identities: IntArray) -> BoolArray:
        """(L,) which landmarks are."""
        return np.asarray(identities < self.before_scan * IDENTITIES_PER_SCAN)
