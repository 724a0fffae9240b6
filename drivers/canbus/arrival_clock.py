"""Monotonic arrival times, freed from the reader's own delay by the stamps of the bus where those make sense."""

JUMP_NS = 500_000_000
LATEST_S = 9e9  # the year 2255; what is later does not fit 64 bits of nanoseconds
LATEST_NS = 5_000_000_000  # no queue is longer: what seems later has stamps of another clock
EARLY_NS = 5_000_000
LONGEST_QUEUE = 2000  # frames after a jump of which any may have been waiting since before it
LEAK = 1e-3  # per second of time: follows a system clock that is slewed (at most 500 ppm), forgets one lucky frame


class ArrivalClock:
    """Stamps of the bus are of the system clock, which jumps, or of an adapter's own, which may begin anew.

    The offset between the clocks is the smallest delay seen, leaking upwards. A jump of the system clock is seen by
    looking at it, so that it is not taken for a reader that was held up, nor the other way round.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._offset_ns: float | None = None
        self._offset_before_ns: float | None = None
        self._system_ahead_ns: int | None = None
        self._last_ns = 0
        self._since_jump = 0

    def stamp_ns(self, monotonic_ns: int, stamp_s: float, system_ns: int | None = None) -> int:
        """When the frame arrived, of the monotonic clock.

        monotonic_ns: when it was read; stamp_s: what the bus says, 0 where it does not; system_ns: the system clock
        when it was read, None where the stamps are not of it.
        """
        if system_ns is not None:
            self._watch_system_clock(system_ns - monotonic_ns)
        if not 0.0 < stamp_s < LATEST_S:  # false for NaN
            return monotonic_ns
        stamp_ns = round(stamp_s * 1e9)
        delay_ns = monotonic_ns - stamp_ns
        elapsed_ns, self._last_ns = monotonic_ns - self._last_ns, monotonic_ns
        if self._offset_ns is None:
            self._offset_ns = delay_ns
            return monotonic_ns
        if self._offset_before_ns is not None:
            self._choose_offset(delay_ns, self._offset_ns, self._offset_before_ns)
        if not -JUMP_NS <= delay_ns - self._offset_ns <= LATEST_NS:
            self.jumps += 1
            self._offset_ns = delay_ns
            return monotonic_ns
        self._offset_ns = min(self._offset_ns + LEAK * elapsed_ns, delay_ns)
        return min(monotonic_ns, round(stamp_ns + self._offset_ns))

    def _watch_system_clock(self, ahead_ns: int) -> None:
        """Take note of how far the system clock is ahead of the monotonic one."""
        if self._system_ahead_ns is not None and abs(ahead_ns - self._system_ahead_ns) > JUMP_NS:
            self.jumps += 1
            if self._offset_ns is not None:
                self._offset_before_ns, self._since_jump = self._offset_ns, 0
                self._offset_ns -= ahead_ns - self._system_ahead_ns
        self._system_ahead_ns = ahead_ns

    def _choose_offset(self, delay_ns: int, one_ns: float, other_ns: float) -> None:
        """After a jump a frame may have been stamped before it: the offset by which it is least late is its own.

        An adapter's stamps do not jump with the system clock, and go on with the offset that they had.
        """
        fitting = [offset for offset in (one_ns, other_ns) if -EARLY_NS <= delay_ns - offset <= LATEST_NS]
        if fitting:
            self._offset_ns = max(fitting)
            self._offset_before_ns = other_ns if self._offset_ns == one_ns else one_ns
        self._since_jump += 1
        if self._since_jump > LONGEST_QUEUE:
            self._offset_before_ns = None
