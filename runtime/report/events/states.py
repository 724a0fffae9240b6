"""How long the rover was in which state, and why, from the events of its health."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.measurements import Event
from runtime.report.finding import Interval

FLAPPING_S = 2.0  # a state that comes back sooner has not been left
SUBJECTS = ("pose", "laser", "encoders", "record", "publish", "review")  # a reason of the health begins with one
MEANWHILE = ("starting", "ready", "stopping")


@dataclass(frozen=True, slots=True)
class StateTime:
    """A state of a run: seconds in it, their share, its spans with short breaks closed, and the reasons by seconds."""

    state: str
    seconds: float
    share: float
    spans: tuple[Interval, ...]
    reasons: tuple[tuple[str, float], ...]


def state_times(events: Sequence[Event], origin_ns: int, until_s: float) -> list[StateTime]:
    """In the order of their seconds, the longest first; empty for a run that told nothing of its health."""
    told = sorted((event for event in events if event.source == "health"), key=lambda event: event.stamp_ns)
    told = [event for event in told if event.kind not in MEANWHILE]
    if not told or until_s <= 0.0:
        return []
    starts = [max(0.0, (event.stamp_ns - origin_ns) * 1e-9) for event in told]
    ends = [*starts[1:], until_s]
    seconds: defaultdict[str, float] = defaultdict(float)
    reasons: dict[str, dict[str, float]] = {}
    spans: dict[str, list[Interval]] = {}
    for event, start, end in zip(told, starts, ends, strict=True):
        end = max(start, min(end, until_s))
        seconds[event.kind] += end - start
        for reason in _reasons(event):
            own_reasons = reasons.setdefault(event.kind, defaultdict(float))
            own_reasons[reason] += end - start
        own = spans.setdefault(event.kind, [])
        if own and start - own[-1][1] <= FLAPPING_S:
            own[-1] = (own[-1][0], end)
        else:
            own.append((start, end))
    return [
        StateTime(state, spent, spent / until_s, tuple(spans[state]), tuple(_longest(reasons.get(state, {}))[:3]))
        for state, spent in _longest(seconds)
    ]


def _longest(seconds: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(seconds.items(), key=lambda item: -item[1])


def _reasons(event: Event) -> list[str]:
    """The first words of each, which name it: what follows are figures, and what to do about it."""
    _, _, text = event.reason.partition(": ")
    heads = [part.split(":")[0].strip() for part in text.split("; ")]
    names = [head.split(",")[0] if re.search(r"\d", head) else head for head in heads]
    return [name for name in names if name.split(" ")[0] in SUBJECTS]
