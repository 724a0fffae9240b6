"""Which scans are of their time: stamps that stand still, run backwards or are far ahead of their tick are refused."""

from slam.estimate import AHEAD_NS


class ScanClock:
    """last_ns: stamp of the last scan that was taken, None before the first."""

    def __init__(self) -> None:
        self.last_ns: int | None = None
        self._tick_ns: int | None = None
        self._refused = self._ahead = 0

    def follow(self, tick_ns: int) -> bool:
        """The next tick; True where the clock was set back: stamps of before are no measure for those that come."""
        is_set_back = self._tick_ns is not None and tick_ns < self._tick_ns - AHEAD_NS
        if is_set_back and self.last_ns is not None:
            self.last_ns = tick_ns - AHEAD_NS
        self._tick_ns = tick_ns
        return is_set_back

    def is_new(self, scan_ns: int, tick_ns: int) -> bool:
        """False for a scan whose time stands still or runs backwards, and for one from after its tick: counted.

        Believed once, a stamp far ahead would make every later scan an old one.
        """
        if scan_ns > tick_ns + AHEAD_NS:
            self._ahead += 1
            return False
        if self.last_ns is not None and scan_ns <= self.last_ns:
            self._refused += 1
            return False
        return True

    @property
    def counts(self) -> dict[str, float]:
        """How many were refused."""
        ahead = {"scan_stamps_ahead_refused": float(self._ahead)} if self._ahead else {}
        return {"scan_stamps_refused": float(self._refused), **ahead}
