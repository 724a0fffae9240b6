"""When a run shows that the rover was carried, pushed or lifted: one scan told it, where landmarks need several."""

import numpy as np

from runtime.report.facts import QUALITIES, RunFacts
from runtime.report.finding import Interval, intervals_where

BEGINS_S = 0.15  # before the span of a doubt: the beat that began it
LIFTED_S = 1.0  # before a scan tells it: from the first push on, wheels and laser part
JOINED_S = 2.0


def began_with_one_scan(facts: RunFacts, doubt: Interval) -> bool:
    """Whether a doubt of the pose began with one scan that fits nowhere near the one before."""
    ticks, score = facts.ticks, facts.ticks.counts.get("doubt_score")
    if score is None:
        return False
    told = np.isfinite(score)
    begun = int(np.searchsorted(ticks.times_s[told], doubt[0] - BEGINS_S))
    steps = np.diff(score[told][max(0, begun - 1) : begun + 2])
    return bool((steps >= facts.configuration.slam.quality.lost_score).any())


def carried_spans(facts: RunFacts) -> tuple[Interval, ...]:
    """From when it was lifted until its place was known again, s: what its wheels say then is no motion over ground."""
    lost = facts.ticks.quality == QUALITIES.index("lost")
    spans = intervals_where(facts.ticks.times_s, lost, JOINED_S)
    return tuple((start - LIFTED_S, end) for start, end in spans if began_with_one_scan(facts, (start, end)))
