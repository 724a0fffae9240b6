"""The 24-bit millisecond counter of a laser, unwrapped; its wraps are distinguished from restarts of the device."""

from enum import Enum, auto

from drivers.scip.codec import COUNTER_MS

NS_PER_MS = 1_000_000
JUMP_MS = 1500  # more than any delay of a message that is worth having; a restart of the device jumps further


class CounterStatus(Enum):
    """What a counter value turned out to be."""

    GOOD = auto()
    STALE = auto()
    RESTARTED = auto()


class CounterUnwrap:
    """24-bit counter of milliseconds to a count that only grows."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None
        self._was_query = False
        self.total_ms = 0
        self.wraps = 0

    def take(self, counter_ms: int, arrival_ns: int, is_query: bool = False) -> CounterStatus:
        """Put the value that arrived at a host time into total_ms.

        is_query: the clock itself, asked with TM. A scan that arrives after it may have begun before it.
        """
        back_ms, self._was_query = JUMP_MS if self._was_query and not is_query else 0, is_query
        if self._last is None:
            self._last, self.total_ms = (counter_ms, arrival_ns), counter_ms
            return CounterStatus.GOOD
        last_ms, last_ns = self._last
        elapsed_ms = (arrival_ns - last_ns) / NS_PER_MS
        step_ms = (counter_ms - last_ms) % COUNTER_MS
        step_ms += COUNTER_MS * round((elapsed_ms - step_ms) / COUNTER_MS)  # a long silence may hide whole wraps
        if step_ms == 0 and not (back_ms or is_query):
            return CounterStatus.STALE
        self._last = (counter_ms, arrival_ns)
        if step_ms < -back_ms or abs(step_ms - elapsed_ms) > JUMP_MS + elapsed_ms * 1e-3:
            self.total_ms = counter_ms
            return CounterStatus.RESTARTED
        self.wraps += (last_ms + step_ms) // COUNTER_MS
        self.total_ms += step_ms
        return CounterStatus.GOOD
