"""Whether a sensor was silent, or only the record has a hole; and what its driver said of the connection."""

import re
from collections.abc import Sequence

import numpy as np

from drivers.measurements import Event
from runtime.report.facts import RunFacts
from runtime.report.finding import Interval

RECORDED_SHARE = 0.5
REPEATED = re.compile(r" \(\d+ more since the last report\)$")
Advice = tuple[str, str]
"""Cause and remedy."""


def while_recorded(facts: RunFacts, intervals: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """Those in which the loop ran and was recorded: where ticks are missing too, no sensor was silent."""
    usual_s = float(np.median(np.diff(facts.ticks.times_s))) if facts.ticks.times_s.size > 1 else 0.1
    kept = []
    for start, end in intervals:
        ticks = int(np.count_nonzero((facts.ticks.times_s >= start) & (facts.ticks.times_s <= end)))
        if ticks >= RECORDED_SHARE * (end - start) / usual_s:
            kept.append((start, end))
    return tuple(kept)


def in_drivers_words(events: Sequence[Event], *kinds: str) -> Advice | None:
    """Cause and remedy as the last event of these kinds has them; None without one. The remedy may be empty."""
    told = [event.reason for event in events if event.kind in kinds]
    if not told:
        return None
    cause, _, remedy = REPEATED.sub("", told[-1]).partition("; ")
    return cause, remedy
