"""Stamps of a log whose clock was set while it ran: moved on so that time goes forward as it did."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray

STEP_S = 1.0  # lines of a log are out of order by less than this; what is farther back is another clock
STEPS_TOLD = 10
PAUSE_S = 86_400.0  # nobody pauses a drive for a day: a step forward of more is another clock as well


@dataclass(frozen=True, slots=True, eq=False)
class JoinedClock:
    """stamps_s (n,): with the steps taken out. good (n,): False for a single stamp that fits neither side.

    steps: (row, seconds) of every step of the clock, negative where it went back.
    """

    stamps_s: FloatArray
    good: BoolArray
    steps: list[tuple[int, float]]


def join_clock(stamps_s: Sequence[float]) -> JoinedClock:
    """Stamps in the order in which they were written. Between the two sides of a step lies one usual interval."""
    given = np.asarray(stamps_s, np.float64)
    intervals_s = np.diff(given)
    usual = intervals_s[(intervals_s > 0.0) & (intervals_s < STEP_S)]
    usual_s = float(np.median(usual)) if usual.size else 0.1
    joined, good = given.copy(), np.ones(len(given), bool)
    steps: list[tuple[int, float]] = []
    offset_s, newest_s = 0.0, given[0] if len(given) else 0.0
    for row, stamp_s in enumerate(given.tolist()):
        now_s = stamp_s + offset_s
        if _is_near(now_s, newest_s):
            newest_s = max(newest_s, now_s)
        elif row + 1 < len(given) and _stays(float(given[row + 1]) + offset_s, now_s, newest_s):
            steps.append((row, now_s - newest_s))
            offset_s += newest_s + usual_s - now_s
            now_s = newest_s = newest_s + usual_s
        else:
            good[row] = False
        joined[row] = now_s
    return JoinedClock(joined, good, steps)


def step_sentences(steps: Sequence[tuple[int, float]], at: Callable[[int], str]) -> list[str]:
    """What is said of a clock's steps, of the first few one by one. at: where a row lies, and whose clock it is."""
    told = [
        f"{at(row)} was set {'back' if step_s < 0.0 else 'forward'} by {abs(step_s):.1f} s; the stamps after it are "
        "shifted so that time goes on"
        for row, step_s in steps[:STEPS_TOLD]
    ]
    more = len(steps) - STEPS_TOLD
    return told + ([f"and {more} more times: the clock of the recording was not monotonic"] if more > 0 else [])


def longest_rising(stamps_s: FloatArray) -> BoolArray:
    """(n,) the largest selection of finite stamps that rises strictly: what is dropped are the few that do not fit."""
    tails: list[float] = []  # smallest last stamp of a rising selection of each length
    tail_rows: list[int] = []
    before = np.full(len(stamps_s), -1)
    for row in np.flatnonzero(np.isfinite(stamps_s)).tolist():
        stamp_s = float(stamps_s[row])
        length = bisect_left(tails, stamp_s)
        if length < len(tails) and tails[length] == stamp_s:
            continue  # of two with the same stamp the first is kept
        before[row] = tail_rows[length - 1] if length else -1
        tails[length : length + 1] = [stamp_s]
        tail_rows[length : length + 1] = [row]
    kept = np.zeros(len(stamps_s), bool)
    row = tail_rows[-1] if tail_rows else -1
    while row >= 0:
        kept[row] = True
        row = int(before[row])
    return kept


def _stays(next_s: float, now_s: float, newest_s: float) -> bool:
    """Whether the stamp after a step goes on from there, and not from where the clock stood before."""
    return _is_near(next_s, now_s) and not _is_near(next_s, newest_s)


def _is_near(stamp_s: float, newest_s: float) -> bool:
    """Whether a stamp can follow the newest one on the same clock."""
    return newest_s - STEP_S <= stamp_s <= newest_s + PAUSE_S
