"""The bytes around an error: what is recorded of the wire when not all of it is."""

from collections import deque

from drivers.measurements import RawTap

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
