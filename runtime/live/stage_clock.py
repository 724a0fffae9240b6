"""How long each stage of a tick took; the stages mark their own ends, so that whoever runs them need not know them."""

from collections.abc import Iterator
from contextlib import contextmanager

from runtime.live.clock import Clock


class StageClock:
    """Durations by name since `begin`, in the order in which the stages ended.

    slam gets `mark` as an argument and knows nothing of time.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._last_ns = 0
        self._durations_ns: dict[str, int] = {}

    def begin(self) -> None:
        """A tick begins."""
        self._last_ns = self.clock.now_ns()
        self._durations_ns = {}

    def mark(self, stage: str) -> None:
        """The stage of this name has ended; it began when the one before ended."""
        now_ns = self.clock.now_ns()
        self._durations_ns[stage] = self._durations_ns.get(stage, 0) + now_ns - self._last_ns
        self._last_ns = now_ns

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """What is done inside is this stage, without what is marked inside as stages of their own."""
        yield
        self.mark(name)

    def durations_ns(self) -> dict[str, int]:
        """Of the tick so far; a copy."""
        return dict(self._durations_ns)


def slowest(durations_ns: dict[str, int]) -> tuple[str, int]:
    """Name and duration of the longest stage."""
    return max(durations_ns.items(), key=lambda item: item[1], default=("nothing", 0))
