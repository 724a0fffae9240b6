import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from drivers.measurements import Severity
from runtime.report.finding import Finding
from tests.support.runtime import typed_trials
from tests.support.runtime.typed_trials import BY_NAME, HEAD, TRIALS, answer, judged, row


@pytest.mark.faults
@pytest.mark.timeout(4 * 3600)
def test_every_fault_typed_at_a_running_rover_is_named_right(tmp_path: Path) -> None:
    sys.stdout.write(f"\n{HEAD}\n")
    right = total = 0
    for name in BY_NAME:
        answers = [answer(name, trial, tmp_path) for trial in range(TRIALS)]
        right, total = right + sum(each.right for each in answers), total + len(answers)
        sys.stdout.write(row(name, answers) + "\n")
        sys.stdout.flush()
    sys.stdout.write(f"{right} of {total} named right\n")
    assert right >= 0.95 * total


def _finding(kind: str, title: str, cause: str, severity: Severity = Severity.WARN) -> Finding:
    return Finding(kind, severity, title, (), cause, "")


def test_a_trial_needs_component_and_cause() -> None:
    silence = BY_NAME["wheels silence"]
    why = "this node lost power, or its cable came loose"
    left = _finding("wheel_silent", "The left wheel encoder stopped sending", why)
    assert judged(silence, 0, [left]).right
    assert not judged(silence, 1, [left]).right  # it was the right one
    assert not judged(silence, 0, [_finding("wheel_silent", left.title, "two nodes send under one id")]).right
    assert not judged(silence, 0, []).right
    pose = _finding("pose_lost", "The pose was lost", "no scans came", Severity.ERROR)
    assert judged(silence, 0, [pose, left]).right  # what the pose does is no name of a sensor's fault


def test_a_fault_that_does_no_harm_may_be_left_out() -> None:
    twice = BY_NAME["wheels duplicate"]
    assert judged(twice, 0, []).right
    assert not judged(twice, 0, [_finding("wheel_jump", "The count of the left wheel jumped", "a restart")]).right


def test_a_trial_that_could_not_be_driven_counts_as_wrong_and_ends_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing = Mock(side_effect=RuntimeError("infant run ended before a line of ticks: "))
    monkeypatch.setattr(typed_trials, "drive", failing)
    found = answer("wheels silence", 0, tmp_path)
    assert (found.kind, found.right) == ("not driven", False)
    assert "before a line of ticks" in row("wheels silence", [found])
