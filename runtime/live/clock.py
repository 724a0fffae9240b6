"""Time as an argument: the loop sees only this."""

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic nanoseconds and a sleep to a point in them."""

    def now_ns(self) -> int:
        """Monotonic time now."""

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at or soon after the deadline; at once if it has passed."""


class MonotonicClock:
    """The host's CLOCK_MONOTONIC, which the simulated devices in another process share."""

    def now_ns(self) -> int:
        """Monotonic time now."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep; Python 3.11 sleeps on an absolute deadline and resumes after a signal handler."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
