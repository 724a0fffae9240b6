"""A delay of the link that changes for good is no drift: all messages of some seconds are then slower than most were
before, or many are faster than any.

A point is (device time in ns, arrival minus device time in ns), the fastest of half a second; `above` gives how far
it lies above the line by which the clock goes.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Point = tuple[int, int]
BUCKET_NS = 500_000_000
STEP_BUCKETS = 16  # eight seconds: whether the delay has changed is judged by the fastest message of each half second
USUAL_BUCKETS, USUAL_BUCKETS_MIN = 160, 24  # of the past against which that is judged
SLOW_SHARE = 0.6  # sixteen in a row of the slower two fifths come by chance once in two million
STEP_MIN_NS = 1_000_000.0  # a smaller change costs no more than the counter's own millisecond
SURE_TURNS = 4  # so often a step must be seen in a row, lest messages from before it are among those that measure it
STEPS_KEPT = 4  # steps that are taken back exactly when the delay returns
EARLY_NS = 700_000.0  # what is faster than all before by more, again and again, has a shorter way


@dataclass(frozen=True, slots=True)
class UsualDelay:
    """Of the fastest messages of half a second each, in ns above the line: slow_ns is what three fifths do not reach,
    fastest_ns where the fastest of eight seconds usually lies, and scatter_ns how far from there it strays.
    """

    fastest_ns: float
    scatter_ns: float
    slow_ns: float


def usual_delay(residuals_ns: Sequence[float]) -> UsualDelay | None:
    """How late the fastest messages usually are; None where too little is known. residuals_ns: of buckets, in order."""
    usual = sorted(residuals_ns)
    if len(usual) < USUAL_BUCKETS_MIN:
        return None
    last = len(usual) - 1
    fastest_ns = usual[round(last * (1.0 - 0.5 ** (1.0 / STEP_BUCKETS)))]
    low_ns, high_ns = (usual[round(last * (1.0 - share ** (1.0 / STEP_BUCKETS)))] for share in (0.8, 0.2))
    return UsualDelay(fastest_ns, high_ns - low_ns, usual[round(last * SLOW_SHARE)])


@dataclass(frozen=True, slots=True)
class DelayStep:
    """The delay is longer by step_ns (shorter where that is negative) from the points `after` on."""

    step_ns: float
    before: list[Point]
    after: list[Point]


class DelaySteps:
    """Finds steps of the delay. count: of those found; pending: messages set aside that may be after one."""

    def __init__(self) -> None:
        self.count = 0
        self._pending: list[Point] = []
        self._is_known = False
        self._slow_turns = 0
        self._taken: deque[tuple[float, float]] = deque(maxlen=STEPS_KEPT)
        self._variance_ns2 = 0.0

    @property
    def is_pending(self) -> bool:
        """Whether messages are set aside; the line must not follow meanwhile."""
        return bool(self._pending)

    @property
    def sigma_ns(self) -> float:
        """What the steps so far may be off by, taken together."""
        return math.sqrt(max(0.0, self._variance_ns2))

    def forget(self) -> None:
        """The delay was measured anew, or is another device's."""
        self._taken.clear()
        self._variance_ns2 = 0.0

    def restart(self) -> None:
        """The points so far are gone."""
        self.forget()
        self._pending.clear()
        self._is_known, self._slow_turns = False, 0

    def is_too_early(self, above_ns: float) -> bool:
        """True for a message that is faster than any can be unless the delay has become shorter."""
        return self._is_known and above_ns < -EARLY_NS

    def set_aside(self, point: Point) -> None:
        """Keep the fastest of each bucket apart, until eight seconds tell whether the delay has become shorter."""
        if not self._pending or point[0] // BUCKET_NS != self._pending[-1][0] // BUCKET_NS:
            self._pending.append(point)
        elif point[1] < self._pending[-1][1]:
            self._pending[-1] = point

    def look(self, points: list[Point], above: Callable[[Point], float], bucket: int) -> DelayStep | list[Point]:
        """Once in a bucket: a step, or what was set aside and is none (mostly nothing)."""
        if self._pending:
            if bucket - self._pending[0][0] // BUCKET_NS < STEP_BUCKETS:
                return []
            pending, self._pending = self._pending, []
            if 2 * sum(self.is_too_early(above(point)) for point in pending) >= STEP_BUCKETS:
                before = [point for point in points if point[0] < pending[0][0] - BUCKET_NS]
                return self._step(before, pending, above)
            return pending  # a few that were faster than any before: the delay was always so short
        before, newest = points[:-STEP_BUCKETS], points[-STEP_BUCKETS:]
        usual = usual_delay([above(point) for point in before[-USUAL_BUCKETS:]])
        self._is_known = usual is not None
        if usual is None:
            return []
        is_slow = min(map(above, newest)) > max(usual.slow_ns, usual.fastest_ns + STEP_MIN_NS)
        self._slow_turns = self._slow_turns + 1 if is_slow else 0
        return self._step(before, newest, above) if self._slow_turns >= SURE_TURNS else []

    def _step(
        self, before: list[Point], after: list[Point], above: Callable[[Point], float]
    ) -> DelayStep | list[Point]:
        usual = usual_delay([above(point) for point in before[-USUAL_BUCKETS:]])
        if usual is None:
            return after
        self._slow_turns = 0
        self.count += 1
        step_ns = min(map(above, after)) - usual.fastest_ns
        for k, (known_ns, variance_ns2) in enumerate(self._taken):
            if abs(step_ns + known_ns) < STEP_MIN_NS:  # it has gone back to what it was
                self._variance_ns2 -= variance_ns2
                del self._taken[k]
                return DelayStep(-known_ns, before, after)
        self._taken.append((step_ns, usual.scatter_ns**2))
        self._variance_ns2 += usual.scatter_ns**2
        return DelayStep(step_ns, before, after)
