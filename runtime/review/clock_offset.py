"""How the laser's own clock runs against the host's, out of the raw bytes as they pass."""

from dataclasses import dataclass

from drivers.laser.timing.counter import CounterUnwrap
from drivers.scip.scan import scan_counters_ms
from runtime.messages.tick import Record, decode_laser_bytes

WINDOW_NS = 1_000_000_000


@dataclass(slots=True)
class ClockState:
    """The last counter with its arrival and unwrapped total; first_ms, least_ms: offsets of the run and this second."""

    counter_ms: int
    arrival_ns: int
    total_ms: int
    first_ms: float
    least_ms: float | None = None
    window_ns: int = 0


class LaserClockOffset:
    """Lower edge, second by second, of arrival minus counter: messages are late at times, never early.

    A clock that runs well draws a level line, one that drifts a slope: 1 ms in 10 s are 100 ppm.
    state: None before the first scan; given again, the curve goes on where it was left off.
    """

    def __init__(self, state: ClockState | None = None) -> None:
        self.state = state
        self._counter = CounterUnwrap()
        if state is not None:
            self._counter.take(state.counter_ms, state.arrival_ns)
            self._counter.total_ms = state.total_ms

    def feed(self, record: Record) -> float | None:
        """One record of /raw/laser; the offset in ms since the start whenever a second has ended, else None."""
        raw = decode_laser_bytes(record.data)
        ended: float | None = None
        for counter_ms in () if raw.sent else scan_counters_ms(raw.data):
            self._counter.take(counter_ms, raw.stamp_ns)
            total_ms = self._counter.total_ms
            offset_ms = raw.stamp_ns * 1e-6 - total_ms
            state = self.state or ClockState(counter_ms, raw.stamp_ns, total_ms, offset_ms)
            state.counter_ms, state.arrival_ns, state.total_ms = counter_ms, raw.stamp_ns, total_ms
            state.least_ms = offset_ms if state.least_ms is None else min(state.least_ms, offset_ms)
            if raw.stamp_ns - state.window_ns >= WINDOW_NS:
                ended = state.least_ms - state.first_ms
                state.least_ms, state.window_ns = None, raw.stamp_ns
            self.state = state
        return ended
