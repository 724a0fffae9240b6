"""How the laser's own clock runs against the host's, out of the raw bytes as they pass."""

from drivers.laser.counter import CounterUnwrap
from drivers.scip.scan import scan_counters_ms
from runtime.messages.tick import Record, decode_laser_bytes

WINDOW_NS = 1_000_000_000


class LaserClockOffset:
    """Lower edge, second by second, of arrival minus counter: messages are late at times, never early.

    A clock that runs well draws a level line, one that drifts a slope: 1 ms in 10 s are 100 ppm.
    """

    def __init__(self) -> None:
        self._counter = CounterUnwrap()
        self._first_ms: float | None = None
        self._least_ms: float | None = None
        self._window_ns = 0

    def feed(self, record: Record) -> float | None:
        """One record of /raw/laser; the offset in ms since the start whenever a second has ended, else None."""
        raw = decode_laser_bytes(record.data)
        ended: float | None = None
        for counter_ms in () if raw.sent else scan_counters_ms(raw.data):
            self._counter.take(counter_ms, raw.stamp_ns)
            offset_ms = raw.stamp_ns * 1e-6 - self._counter.total_ms
            self._first_ms = offset_ms if self._first_ms is None else self._first_ms
            self._least_ms = offset_ms if self._least_ms is None else min(self._least_ms, offset_ms)
            if raw.stamp_ns - self._window_ns >= WINDOW_NS:
                ended = self._least_ms - self._first_ms
                self._least_ms, self._window_ns = None, raw.stamp_ns
        return ended
