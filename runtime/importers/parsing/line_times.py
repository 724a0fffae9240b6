"""Times of the lines of a log: which of its stamps can be used, and what is done where their digits are lost."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from runtime.importers.parsing.clock_steps import JoinedClock, join_clock
from runtime.importers.parsing.left_out import MUCH

PAUSE_S = 10.0  # stamps that go on by more than this tell no more when the lines between them were written
ASSUMED_S = 0.2  # from one line to the next where nobody knows, of scans or odometry, whichever are more


@dataclass(frozen=True, slots=True, eq=False)
class LineTimes:
    """stamps_s (n,), rising with the lines where they were spread; good (n,): False where a line has no time.

    steps: (row, seconds) of the clock's steps that were taken out. lost: what was done about stamps that are too
    coarse, "" where they are not.
    """

    stamps_s: FloatArray
    good: BoolArray
    steps: list[tuple[int, float]] = field(default_factory=list)
    lost: str = ""


def line_times(columns: Sequence[FloatArray], is_scan: BoolArray, is_odometry: BoolArray) -> LineTimes:
    """Times of n lines in the order of writing. columns: each (n,), the stamps of the line, the usual ones first.

    A later column is taken where more scans can be told apart by it. Where more than 1 % of the scans share their
    stamp with another, lines with the same stamp are spread evenly up to the next; where even that tells nothing, all
    lines are.
    """
    wanted = (1.0 - MUCH) * np.count_nonzero(is_scan)
    clocks = [join_clock(columns[0].tolist())]
    if _told_apart(clocks[0], is_scan) < wanted:
        clocks += [join_clock(column.tolist()) for column in columns[1:]]
    clock = max(clocks, key=lambda each: _told_apart(each, is_scan))
    if _told_apart(clock, is_scan) >= wanted:
        return LineTimes(clock.stamps_s, clock.good, clock.steps)
    spread_s = _spread(clock.stamps_s) if clock.good.all() and not clock.steps else None
    if spread_s is not None:
        said = "lines with the same stamp are spread evenly up to the next stamp"
    else:
        beats = max(np.count_nonzero(is_scan), np.count_nonzero(is_odometry))
        spread_s = np.arange(len(is_scan)) * (ASSUMED_S * beats / len(is_scan))
        said = f"lines are put in order, {ASSUMED_S} s apart: speeds are not real"
    return LineTimes(
        spread_s,
        np.ones(len(is_scan), bool),
        lost=f"only {_told_apart(clock, is_scan)} of {np.count_nonzero(is_scan)} scans have distinct stamps, "
        f"because digits are missing or stamps jump; {said}",
    )


def _told_apart(clock: JoinedClock, is_scan: BoolArray) -> int:
    """How many scans have a stamp of their own."""
    return int(np.unique(clock.stamps_s[clock.good & is_scan]).size)


def _spread(stamps_s: FloatArray) -> FloatArray | None:
    """Lines of the same stamp, evenly up to the next; None where most of the lines lie before a pause or at the end."""
    firsts = np.flatnonzero(np.diff(stamps_s, prepend=-np.inf) > 0.0)
    ends = np.append(firsts[1:], len(stamps_s))
    until_s = np.append(stamps_s[firsts[1:]], np.inf)
    steps_s = (until_s - stamps_s[firsts]) / (ends - firsts)
    is_known = until_s - stamps_s[firsts] <= PAUSE_S
    if (np.diff(stamps_s) < 0.0).any() or 2 * (ends - firsts)[is_known].sum() < len(stamps_s):
        return None
    steps_s[~is_known] = np.median(np.repeat(steps_s[is_known], (ends - firsts)[is_known]))
    within = np.arange(len(stamps_s)) - np.repeat(firsts, ends - firsts)
    spread: FloatArray = np.repeat(stamps_s[firsts], ends - firsts) + within * np.repeat(steps_s, ends - firsts)
    return spread
