"""What the laser driver tells of itself: counters by reason, events, and the bytes around an error."""

from collections import Counter, deque

from drivers.measurements import Event, RawTap, Severity

EVENTS = 256
REPEAT_NS = 1_000_000_000
AROUND_NS = 2_000_000_000


class AroundErrors:
    """Hands bytes on only from two seconds before an error until two seconds after the last one."""

    def __init__(self, tap: RawTap) -> None:
        self._tap = tap
        self._ring: deque[tuple[int, bool, bytes]] = deque()
        self._until_ns: int | None = None

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        """Keep for two seconds, or hand on."""
        if self._until_ns is not None and stamp_ns <= self._until_ns:
            self._tap.laser_bytes(stamp_ns, sent, data)
            return
        self._ring.append((stamp_ns, sent, data))
        while self._ring[0][0] < stamp_ns - AROUND_NS:
            self._ring.popleft()

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        """Not the laser's; handed on."""
        self._tap.can_frame(stamp_ns, arbitration_id, flags, data)

    def error(self, stamp_ns: int) -> None:
        """An error at this time: what was kept is handed on, and what comes."""
        while self._ring:
            stamp, sent, data = self._ring.popleft()
            if stamp >= stamp_ns - AROUND_NS:
                self._tap.laser_bytes(stamp, sent, data)
        self._until_ns = stamp_ns + AROUND_NS


class LaserJournal:
    """Written by the reader thread, drained by the loop."""

    def __init__(self, around: AroundErrors | None = None) -> None:
        self._around = around
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._told: dict[str, tuple[int, int]] = {}
        self.counters: Counter[str] = Counter()
        self.trouble = ""

    def count(self, counter: str) -> None:
        """Add to a counter without an event."""
        self.counters[counter] += 1

    def note(self, stamp_ns: int, kind: str, reason: str, severity: Severity = Severity.INFO, amount: int = 1) -> None:
        """Count `kind` and tell of it; the same kind again within a second is only counted."""
        self.counters[kind] += amount
        if severity is not Severity.INFO:
            self.trouble = reason
            if self._around is not None:
                self._around.error(stamp_ns)
        told_ns, untold = self._told.get(kind, (stamp_ns - REPEAT_NS, 0))
        if stamp_ns - told_ns < REPEAT_NS:
            self._told[kind] = (told_ns, untold + 1)
            return
        text = f"{reason} (and {untold} more before)" if untold else reason
        self._events.append(Event(stamp_ns, "laser", kind, text, severity))
        self._told[kind] = (stamp_ns, 0)

    def drain(self) -> tuple[Event, ...]:
        """Events since the last call."""
        events = []
        while self._events:
            events.append(self._events.popleft())
        return tuple(events)
