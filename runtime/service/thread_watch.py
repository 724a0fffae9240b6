"""Heartbeats of the threads beside the loop: the service manager's watchdog is fed only while all of them come.

A thread that hangs in our own code is mended by a restart; a thread that waits for a disk is not, and is a state
instead (storage never stops the loop). A silent sensor is neither: its thread goes on waiting, and says so.
"""

from collections.abc import Callable

from drivers.measurements import Event, Severity

TOLD_NS = 5_000_000_000  # how long a failure is a trouble: long enough to be seen
TIMEOUT_S = 30.0  # longer than a connection attempt, a baud search and a stalled SD card together


class ThreadWatch:
    """Hands out one heartbeat to each thread and tells which of them has not given it for too long.

    Heartbeats may come from any thread. timeout_s is added to what a thread is known to wait at most.
    """

    def __init__(self, now_ns: Callable[[], int], timeout_s: float = TIMEOUT_S) -> None:
        self.now_ns = now_ns
        self._timeout_s = timeout_s
        self._limits_s: dict[str, float] = {}
        self._last_ns: dict[str, int] = {}
        self._silence_allowed: dict[str, Callable[[], bool]] = {}
        self._reported: set[str] = set()

    def heartbeat(self, thread: str, longest_wait_s: float = 0.0) -> Callable[[], None]:
        """What the thread calls in each round of its work; counted from `begin` on."""
        self._limits_s[thread] = self._timeout_s + longest_wait_s

        def beat() -> None:
            self._last_ns[thread] = self.now_ns()

        return beat

    def allow_silence(self, thread: str, may_be_silent: Callable[[], bool]) -> None:
        """Silence of this thread is not counted while may_be_silent() is true."""
        self._silence_allowed[thread] = may_be_silent

    def begin(self) -> None:
        """The threads have been started."""
        now_ns = self.now_ns()
        self._last_ns |= dict.fromkeys(self._limits_s, now_ns)

    def stuck(self) -> str:
        """One sentence on the threads that hang; empty if there are none."""
        return "; ".join(_hangs(thread, ns) for thread, ns in self._silent_ns().items())

    def drain_events(self) -> tuple[Event, ...]:
        """What has changed since the last call: threads that hang now, and threads that work again."""
        silent_ns, now_ns = self._silent_ns(), self.now_ns()
        events = [
            Event(now_ns, thread, "hangs", f"{_hangs(thread, ns)}; the watchdog is not fed meanwhile", Severity.ERROR)
            for thread, ns in silent_ns.items()
            if thread not in self._reported
        ]
        again = self._reported - silent_ns.keys()
        events += [Event(now_ns, each, "hangs", f"the thread {each} works again") for each in sorted(again)]
        self._reported = set(silent_ns)
        return tuple(events)

    def _silent_ns(self) -> dict[str, int]:
        """Threads that hang, and for how long."""
        now_ns = self.now_ns()
        silent_ns = {thread: now_ns - last_ns for thread, last_ns in self._last_ns.items()}
        return {
            thread: ns
            for thread, ns in silent_ns.items()
            if ns > round(self._limits_s[thread] * 1e9) and not self._is_silence_allowed(thread)
        }

    def _is_silence_allowed(self, thread: str) -> bool:
        return thread in self._silence_allowed and self._silence_allowed[thread]()


class Failures:
    """What was raised in a thread that is begun again each time: counted, and a trouble for some seconds."""

    def __init__(self, thread: str, now_ns: Callable[[], int]) -> None:
        self._thread = thread
        self._now_ns = now_ns
        self._count = 0
        self._last = ("", 0)

    def note(self, what: str) -> None:
        """One more, in a sentence."""
        self._count += 1
        self._last = (what, self._now_ns())

    @property
    def trouble(self) -> str:
        """What was raised last, "" when that is some seconds ago."""
        what, at_ns = self._last
        if not what or self._now_ns() - at_ns > TOLD_NS:
            return ""
        return f"the thread {self._thread} failed and was restarted ({self._count} so far): {what}"


def _hangs(thread: str, silent_ns: int) -> str:
    return f"the thread {thread} has not responded for {silent_ns * 1e-9:.0f} s"
