"""Signs of life of the threads beside the loop: the service manager's watchdog is fed only while all of them give some.

A thread that hangs in our own code is mended by a restart; a thread that waits for a disk is not, and is a state
instead (storage never stops the loop). A silent sensor is neither: its thread goes on waiting, and says so.
"""

from collections.abc import Callable

from drivers.measurements import Event, Severity

PATIENCE_S = 30.0  # longer than a connection attempt, a baud search and a stalled SD card together


class ThreadWatch:
    """Hands out one sign to each thread and tells which of them has not given it for too long.

    Signs may come from any thread. patience_s is added to what a thread is known to wait at most.
    """

    def __init__(self, now_ns: Callable[[], int], patience_s: float = PATIENCE_S) -> None:
        self._now_ns = now_ns
        self._patience_s = patience_s
        self._limits_s: dict[str, float] = {}
        self._last_ns: dict[str, int] = {}
        self._excused: dict[str, Callable[[], bool]] = {}
        self._told: set[str] = set()

    def sign(self, thread: str, longest_wait_s: float = 0.0) -> Callable[[], None]:
        """What the thread calls whenever it gets round; counted from `begin` on."""
        self._limits_s[thread] = self._patience_s + longest_wait_s

        def alive() -> None:
            self._last_ns[thread] = self._now_ns()

        return alive

    def excuse(self, thread: str, is_excused: Callable[[], bool]) -> None:
        """Silence of this thread is not counted while is_excused() is true."""
        self._excused[thread] = is_excused

    def begin(self) -> None:
        """The threads have been started."""
        now_ns = self._now_ns()
        self._last_ns |= dict.fromkeys(self._limits_s, now_ns)

    def stuck(self) -> str:
        """One sentence on the threads that hang; empty if there are none."""
        return "; ".join(_hangs(thread, ns) for thread, ns in self._silent_ns().items())

    def drain_events(self) -> tuple[Event, ...]:
        """What has changed since the last call: threads that hang now, and threads that get round again."""
        silent_ns, now_ns = self._silent_ns(), self._now_ns()
        events = [
            Event(now_ns, thread, "hangs", f"{_hangs(thread, ns)}; the watchdog is not fed meanwhile", Severity.ERROR)
            for thread, ns in silent_ns.items()
            if thread not in self._told
        ]
        again = self._told - silent_ns.keys()
        events += [Event(now_ns, each, "hangs", f"the thread {each} gets round again") for each in sorted(again)]
        self._told = set(silent_ns)
        return tuple(events)

    def _silent_ns(self) -> dict[str, int]:
        """Threads that hang, and for how long."""
        now_ns = self._now_ns()
        silent_ns = {thread: now_ns - last_ns for thread, last_ns in self._last_ns.items()}
        return {
            thread: ns
            for thread, ns in silent_ns.items()
            if ns > round(self._limits_s[thread] * 1e9) and not self._is_excused(thread)
        }

    def _is_excused(self, thread: str) -> bool:
        return thread in self._excused and self._excused[thread]()


def _hangs(thread: str, silent_ns: int) -> str:
    return f"the thread {thread} has not got round for {silent_ns * 1e-9:.0f} s"


def no_sign() -> None:
    """For a thread that nobody watches."""
