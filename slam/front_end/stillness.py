"""Which beams have long shown the same to a rover that stands: people stay for seconds where they wait or talk."""

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray

STILL_NS = 20_000_000_000
SAME_M = 0.1  # a range that changes by less is the same thing
LEAST_RETURNED = 0.5  # of the scans in which a beam showed nothing else it showed that
STILL_SHARE = 0.65  # of a feature's returns


class Stillness:
    """Remembers for each beam what it showed first, since when it has shown nothing else, and how often."""

    def __init__(self) -> None:
        self._ranges_m = np.zeros(0)
        self._since_ns = self._scans = self._shown = np.zeros(0, dtype=np.int64)

    def follow(self, ranges_m: FloatArray, stamp_ns: int, *, stands: bool) -> None:
        """One scan more; ranges_m (n,), NaN where nothing came back. stands: the wheels do."""
        if not stands or len(ranges_m) != len(self._ranges_m):
            self._begin(len(ranges_m), stamp_ns)
        if not stands:
            return
        same = np.abs(ranges_m - self._ranges_m) < SAME_M
        other = ~same & ~np.isnan(ranges_m)
        self._ranges_m = np.where(other, ranges_m, self._ranges_m)
        self._since_ns = np.where(other, stamp_ns, self._since_ns)
        self._scans = np.where(other, 1, self._scans + 1)
        self._shown = np.where(other, 1, self._shown + same)

    def licences(self, ranges_m: FloatArray, stamp_ns: int, extents: IntArray) -> BoolArray:
        """(k,) True where enough of the returns from the first to the last beam (k, 2) have been still for long."""
        returned = ~np.isnan(ranges_m)
        shown = self._shown >= LEAST_RETURNED * self._scans
        still = returned & shown & (stamp_ns - self._since_ns >= STILL_NS)
        of_all, of_still = (np.concatenate(([0], np.cumsum(beams))) for beams in (returned, still))
        first, last = extents[:, 0], extents[:, 1] + 1
        enough: BoolArray = of_still[last] - of_still[first] >= STILL_SHARE * (of_all[last] - of_all[first])
        return enough

    def _begin(self, beams: int, stamp_ns: int) -> None:
        self._ranges_m = np.full(beams, np.nan)
        self._since_ns = np.full(beams, stamp_ns, dtype=np.int64)
        self._scans, self._shown = np.zeros(beams, dtype=np.int64), np.zeros(beams, dtype=np.int64)
