"""Monotonic arrival times, smoothed by the kernel's own stamps where those make sense."""

JUMP_NS = 500_000_000
LEAK = 1e-3  # per second of time: follows a system clock that is slewed (at most 500 ppm), forgets one lucky frame


class ArrivalClock:
    """Kernel stamps are of the system clock, which jumps; they serve only to take out the reader's own delay.

    The offset between the clocks is the smallest delay seen, leaking upwards; a jump of either clock anchors it
    anew and is counted.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._offset_ns: float | None = None
        self._last: tuple[int, int] | None = None

    def stamp_ns(self, monotonic_ns: int, system_s: float) -> int:
        """When the frame arrived. monotonic_ns: when it was read; system_s: what the bus says, 0 where it does not."""
        if system_s <= 0.0:
            return monotonic_ns
        system_ns = round(system_s * 1e9)
        delay_ns = monotonic_ns - system_ns
        last = self._last
        self._last = (monotonic_ns, system_ns)
        if self._offset_ns is None or last is None:
            self._offset_ns = delay_ns
            return monotonic_ns
        elapsed_ns, system_elapsed_ns = monotonic_ns - last[0], system_ns - last[1]
        if abs(system_elapsed_ns - elapsed_ns) > JUMP_NS:
            self.jumps += 1
            self._offset_ns = delay_ns
            return monotonic_ns
        self._offset_ns = min(self._offset_ns + LEAK * elapsed_ns, delay_ns)
        return min(monotonic_ns, round(system_ns + self._offset_ns))
