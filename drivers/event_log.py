"""Events of one driver, rate-limited by kind, so that a flood on the wire is no flood in the log."""

from collections import deque

from drivers.measurements import Event, Severity

REPEAT_NS = 5_000_000_000
LENGTH = 500


class EventLog:
    """Keeps events until they are drained; the same kind again within 5 s is counted and told with the next one."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._events: deque[Event] = deque(maxlen=LENGTH)
        self._last_ns: dict[str, int] = {}
        self._withheld: dict[str, int] = {}

    def add(self, stamp_ns: int, kind: str, reason: str, severity: Severity = Severity.WARN, key: str = "") -> None:
        """Note an event. key: what is rate-limited, the kind where empty."""
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
