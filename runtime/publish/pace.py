"""How often something may be said or answered."""


class Pace:
    """True at most `hz` times a second of the stamps it is asked with; never for 0 Hz."""

    def __init__(self, hz: float) -> None:
        self._period_ns = round(1e9 / hz) if hz > 0 else None
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Whether it is time; the grid is kept, so that 2 Hz out of 10 Hz are exactly 2 Hz."""
        if self._period_ns is None:
            return False
        if self._next_ns is None or stamp_ns >= self._next_ns + 10 * self._period_ns:
            self._next_ns = stamp_ns
        if stamp_ns < self._next_ns:
            return False
        self._next_ns += self._period_ns
        return True


class Allowance:
    """Lets `hz` things a second happen, whoever asks for them, and as many at once after a pause of a second."""

    def __init__(self, hz: float) -> None:
        self._hz = hz
        self._left = hz
        self._last_ns: int | None = None

    def take(self, now_ns: int) -> bool:
        """Whether one more may happen now."""
        if self._last_ns is not None:
            self._left = min(self._hz, self._left + (now_ns - self._last_ns) * 1e-9 * self._hz)
        self._last_ns = now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
