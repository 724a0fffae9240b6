"""Whether a sensor was silent, or only the record has a hole."""

import numpy as np

from runtime.report.facts import RunFacts
from runtime.report.finding import Interval

RECORDED_SHARE = 0.5


def while_recorded(facts: RunFacts, intervals: tuple[Interval, ...]) -> tuple[Interval, ...]:
    """Those in which the loop ran and was recorded: where ticks are missing too, no sensor was silent."""
    usual_s = float(np.median(np.diff(facts.ticks.times_s))) if facts.ticks.times_s.size > 1 else 0.1
    kept = []
    for start, end in intervals:
        ticks = int(np.count_nonzero((facts.ticks.times_s >= start) & (facts.ticks.times_s <= end)))
        if ticks >= RECORDED_SHARE * (end - start) / usual_s:
            kept.append((start, end))
    return tuple(kept)
