"""What follows from what, and how often."""

from dataclasses import replace

import pytest

from drivers.measurements import Severity
from runtime.report.causality import ordered
from runtime.report.finding import Finding

SILENT = Finding("laser_silent", Severity.WARN, "The laser was silent", (), "its cable", "check it", ((60.0, 65.0),))
LOST = Finding("pose_lost", Severity.ERROR, "The pose was lost", (), "unknown", "drive slower")


@pytest.mark.parametrize(
    ("starts_s", "cause"),
    [
        ((62.0,), "it follows from: The laser was silent"),
        ((31.0, 62.0), "1 of 2 times it follows from: The laser was silent"),
        ((31.0, 40.0, 62.0), "unknown"),
    ],
)
def test_only_what_began_with_its_cause_is_said_to_follow_from_it(starts_s: tuple[float, ...], cause: str) -> None:
    lost = replace(LOST, intervals=tuple((start_s, start_s + 1.0) for start_s in starts_s))
    (told,) = (each for each in ordered([lost, SILENT]) if each.kind == "pose_lost")
    assert told.cause == cause
    assert bool(told.follows) is (cause != "unknown")
