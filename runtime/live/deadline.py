"""When a run has to be over: what a user gives it counts from the start of the process to its end."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

CLOSING_NS = 2_000_000_000  # the record and the picture are closed in it; 1.1 s were seen on a busy machine
LEAVING_NS = 500_000_000  # the last part of it, for the summary and the end of the process
NEVER_NS = 1 << 62
STAT = Path("/proc/self/stat")
START_FIELD = 19  # of what follows the name in /proc/PID/stat: starttime, in clock ticks since the machine booted


class TimeIsOver(BaseException):
    """The time of a run was over before its first tick; the message says during what, "" where that is of no help.

    Like KeyboardInterrupt it may come anywhere, and nobody else may catch it.
    """


@dataclass(frozen=True, slots=True)
class Deadline:
    """ends_ns: on the monotonic clock; closing_ns: how much before that the last tick is. Without words: no end."""

    ends_ns: int = NEVER_NS
    closing_ns: int = 0

    @classmethod
    def after(cls, duration_s: float, began_ns: int) -> "Deadline":
        """So many seconds after the process began; at least half of them are for driving."""
        return cls(began_ns + round(duration_s * 1e9), min(CLOSING_NS, round(duration_s * 0.5e9)))

    @property
    def drive_until_ns(self) -> int:
        """No tick from then on."""
        return self.ends_ns - self.closing_ns

    @property
    def closed_by_ns(self) -> int:
        """What can be made again is not waited for from then on."""
        return self.ends_ns - min(LEAVING_NS, self.closing_ns // 2)

    @contextmanager
    def interrupts(self, now_ns: int) -> Iterator[None]:
        """While within, raise TimeIsOver when no time is left for driving, whatever the main thread waits for."""
        if self.ends_ns == NEVER_NS:
            yield
            return
        left_ns = self.drive_until_ns - now_ns
        if left_ns <= 0:
            raise TimeIsOver

        def is_over(_number: int, _frame: object) -> None:
            raise TimeIsOver

        before = signal.signal(signal.SIGALRM, is_over)
        signal.setitimer(signal.ITIMER_REAL, left_ns * 1e-9)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)


def process_began_ns() -> int:
    """When this process began, on the monotonic clock; the kernel keeps it to 10 ms."""
    ticks = int(STAT.read_text(encoding="utf-8").rpartition(")")[2].split()[START_FIELD])
    age_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - ticks * 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    return time.monotonic_ns() - age_ns
