"""A clock that skips the time in which nobody works: hours of driving in the minutes that their work takes."""

import time
from collections.abc import Callable

Leap = Callable[[int], None]
Meanwhile = Callable[[int, Leap], None]


class LeapingClock:
    """Runs at life's pace while the loop works, and leaps to the next beat when the loop sleeps.

    A tick that takes longer than its period is late and misses beats exactly as on a rover; a computer that is too
    slow for `speed` only makes the whole take longer. `speed`: how many times faster than life it may go at most.
    meanwhile: called with the deadline of each sleep and the function that moves the clock: lets happen what happens
    until then. One thread sleeps, any may ask for the time.
    """

    def __init__(self, speed: float, meanwhile: Meanwhile, work_takes_time: bool = True) -> None:
        """work_takes_time: False where time shall stand while the loop works, so that no computer is too slow."""
        self._speed = speed
        self._work_takes_time = work_takes_time
        self._meanwhile = meanwhile
        self._skipped_ns = 0
        self._standing_ns: int | None = None
        self._began: tuple[int, int] | None = None  # real and own time of the first sleep

    def now_ns(self) -> int:
        """Monotonic time: the host's and all that was skipped."""
        standing_ns = self._standing_ns
        return time.monotonic_ns() + self._skipped_ns if standing_ns is None else standing_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Let happen what happens until then, and go on there; waits only as far as `speed` asks for it."""
        self._standing_ns = max(self.now_ns(), 0)
        if self._began is None:
            self._began = (time.monotonic_ns(), self._standing_ns)
        self._meanwhile(max(deadline_ns, self._standing_ns), self._leap)
        self._leap(deadline_ns)
        real_ns, own_ns = self._began
        early_ns = real_ns + (self._standing_ns - own_ns) / self._speed - time.monotonic_ns()
        if early_ns > 0:
            time.sleep(early_ns * 1e-9)
        if self._work_takes_time:
            self._skipped_ns = self._standing_ns - time.monotonic_ns()
            self._standing_ns = None

    def _leap(self, to_ns: int) -> None:
        assert self._standing_ns is not None
        self._standing_ns = max(self._standing_ns, to_ns)
