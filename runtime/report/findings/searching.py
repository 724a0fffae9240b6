"""Whether a run that began anywhere in a saved map found its place there."""

import numpy as np

from drivers.measurements import Severity
from runtime.record.trajectories import begins_searching, searched_rows
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding


def searching_findings(facts: RunFacts) -> list[Finding]:
    """One, for such a run."""
    if not begins_searching(facts.ticks.counts):
        return []
    until_s = searched_until_s(facts)
    searching = facts.ticks.times_s <= until_s
    driven_m = float(np.hypot(*np.diff(facts.ticks.odometry[searching, :2], axis=0).T).sum())
    if is_never_found(facts):
        severity = Severity.ERROR
        title = "The rover's place in the saved map was never known: the pose is that of odometry"
        cause = "the drive did not come to a place that the map shows, or the place has changed since"
        remedy = "start where the map was made, or give the place with --start-at; look at both with infant map draw"
    else:
        severity = Severity.INFO
        title = f"The rover's place in the saved map was known after {until_s:.1f} s; before that the pose was odometry"
        cause = "the run began without a pose in the map"
        remedy = "no action needed: with --start-at the place is known at once"
    return [Finding("searching", severity, title, (f"{driven_m:.1f} m driven",), cause, remedy, ((0.0, until_s),))]


def is_never_found(facts: RunFacts) -> bool:
    """Whether the run looked for its place to its end."""
    return begins_searching(facts.ticks.counts) and not searched_rows(facts.ticks.counts)


def searched_until_s(facts: RunFacts) -> float:
    """When the place was known; 0 for a run that knew it from the beginning."""
    if not begins_searching(facts.ticks.counts):
        return 0.0
    rows = searched_rows(facts.ticks.counts)
    return float(facts.ticks.times_s[rows]) if rows else facts.duration_s
