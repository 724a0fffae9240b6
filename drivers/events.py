"""What a driver reports of itself: counters by kind, and events limited in rate, so that a flood of faults on the wire
does not flood the log.
"""

from collections import Counter, deque
from collections.abc import Callable

from drivers.measurements import Event, Severity

REPEAT_NS = 1_000_000_000
LENGTH = 500


class EventLog:
    """Written by a driver's reader thread, drained by the loop; the oldest events give way where nobody drains.

    source: the sensor's name in every event. on_trouble: called with the stamp of each event above information.
    trouble: the reason of the last such event, until the driver clears it.
    """

    def __init__(self, source: str, on_trouble: Callable[[int], None] | None = None) -> None:
        self._source, self._on_trouble = source, on_trouble
        self._events: deque[Event] = deque(maxlen=LENGTH)
        self._last_ns: dict[str, int] = {}
        self._withheld: dict[str, int] = {}
        self.counters: Counter[str] = Counter()
        self.trouble = ""

    def count(self, kind: str, amount: int = 1) -> None:
        """Add to a counter without an event."""
        self.counters[kind] += amount

    def add(
        self,
        stamp_ns: int,
        kind: str,
        reason: str,
        severity: Severity = Severity.WARN,
        *,
        amount: int = 1,
        key: str = "",
    ) -> None:
        """Count `kind` and report it; what has the same key within a second is counted and summed up in the next one.

        amount: how many occurrences to count, 0 where another counter has them. key: what is limited in rate, `kind`
        where empty.
        """
        self.counters[kind] += amount
        if severity is not Severity.INFO:
            self.trouble = reason
            if self._on_trouble is not None:
                self._on_trouble(stamp_ns)
        key = key or kind
        last_ns = self._last_ns.get(key)
        if last_ns is not None and 0 <= stamp_ns - last_ns < REPEAT_NS:
            self._withheld[key] = self._withheld.get(key, 0) + 1
            return
        more = self._withheld.pop(key, 0)
        text = f"{reason} ({more} more since the last report)" if more else reason
        self._last_ns[key] = stamp_ns
        self._events.append(Event(stamp_ns, self._source, kind, text, severity))

    def drain(self) -> tuple[Event, ...]:
        """Events since the last call, oldest first."""
        events = []
        while self._events:
            events.append(self._events.popleft())
        return tuple(events)
