from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Event, Severity
from runtime.report.causality import ordered
from runtime.report.facts import RunFacts, WheelColumns
from runtime.report.finding import Finding
from runtime.report.findings.wheels import wheel_findings
from tests.support.runtime.seeded_runs import seeded_facts

START_S, END_S = 4.0, 6.0


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> RunFacts:
    """A run of 8 s in which no wheel sample is good from START_S to END_S."""
    made = seeded_facts(tmp_path_factory.mktemp("run"), 1, duration_s=8.0)
    inside = (made.wheels.times_s > START_S) & (made.wheels.times_s < END_S)
    return replace(made, wheels=replace(made.wheels, valid=made.wheels.valid & ~inside))


def _told(facts: RunFacts, *said: tuple[float, str, str]) -> list[Finding]:
    events = [Event(facts.origin_ns + round(s * 1e9), "encoders", kind, why, Severity.WARN) for s, kind, why in said]
    return ordered(wheel_findings(replace(facts, events=tuple(events))))


def test_two_silent_wheels_are_not_called_one(facts: RunFacts) -> None:
    silent = "wheel: silent: no good frame for 0.2 s; check power and cable of the node"
    both = _told(facts, (4.2, "invalid", f"left {silent}"), (4.2, "invalid", f"right {silent}"))
    assert both[0].title.startswith("Both wheel encoders stopped sending")
    (one,) = _told(facts, (4.2, "invalid", f"right {silent}"))
    assert one.title.startswith("The right wheel encoder stopped sending")


def test_a_count_that_stands_still_is_no_loss_of_power(facts: RunFacts) -> None:
    stands = "left wheel: the count stands still while the speed signal does not; check the encoder"
    told = _told(facts, (4.0, "stuck", stands), (4.1, "gap", "left wheel: starts again"), (5.0, "stuck", stands))
    assert [finding.kind for finding in told] == ["wheel_stuck"]
    assert told[0].title.startswith("The left wheel encoder was stuck during 4.0-5.0 s")


def test_a_node_that_was_off_restarts_because_of_that(facts: RunFacts) -> None:
    told = _told(
        facts,
        (4.2, "invalid", "left wheel: silent: no good frame for 0.2 s"),
        (6.1, "gap", "left wheel: starts again"),
        (6.5, "restart", "left wheel: the node has restarted 500 ms ago"),
    )
    assert told[0].kind == "wheel_silent"
    assert "and then restarted" in told[0].title
    assert "lost power" in told[0].cause
    assert [finding.follows for finding in told[1:]] == ["wheel_silent"]


def test_frames_that_are_refused_do_arrive(facts: RunFacts) -> None:
    why = "right wheel: the length of the frames differs from that of the layout; check the layout"
    told = _told(facts, *((4.0 + n, "length", why) for n in range(3)), (4.2, "invalid", why))
    assert told[0].title.startswith("The right wheel encoder gave no usable counts")
    assert "wrong length" in told[0].cause


@pytest.mark.parametrize(
    ("kind", "word"), [("bus_off", "off the bus"), ("passive", "error-passive"), ("bitrate", "bit rate")]
)
def test_a_bus_in_trouble_is_named_and_no_wheel(facts: RunFacts, kind: str, word: str) -> None:
    told = _told(facts, (4.0, kind, "CAN bus: trouble"), (4.2, "invalid", "left wheel: silent: no good frame"))
    assert told[0].kind == "odometry_silent"
    assert word in told[0].cause


@pytest.mark.parametrize(("waited_s", "word"), [(5.0, "flooded the bus"), (3.95, "lost power"), (5.95, "lost power")])
def test_frames_that_wait_while_no_wheel_is_heard_are_a_flood(facts: RunFacts, waited_s: float, word: str) -> None:
    silent = "wheel: silent: no good frame for 0.2 s; check power and cable of the node"
    both = [(4.2, "invalid", f"{side} {silent}") for side in ("left", "right")]
    told = _told(facts, *both, (waited_s, "late", "frames waited before they were read"))
    assert word in told[0].cause


NO_FRAME = "CAN bus socketcan can0: no frame at all; check that the nodes have power"
NO_BUS = "CAN bus can0 does not exist on this computer; bring it up with ip link"


@pytest.mark.parametrize(
    ("told", "title", "cause", "remedy"),
    [
        ((-0.5, "silent", NO_FRAME), "Both wheel encoders sent nothing in", "no frame with a configured id", "--live"),
        ((-0.5, "open", f"{NO_BUS} (3 more since the last report)"), "Both wheel", "can0 does not exist on", "ip link"),
        ((1.0, "length", "left wheel: the length differs"), "The left wheel encoder gave no", "wrong length", "its"),
    ],
)
def test_wheels_that_never_spoke_are_told_with_what_the_driver_met(
    facts: RunFacts, told: tuple[float, str, str], title: str, cause: str, remedy: str
) -> None:
    nothing = replace(facts, wheels=WheelColumns(np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.bool_)))
    (finding,) = [each for each in _told(nothing, told) if each.kind.endswith("_silent")]
    assert finding.title.startswith(title)
    assert finding.title.endswith("in the whole run")
    assert finding.cause.startswith(cause) or cause in finding.cause
    assert remedy in finding.remedy
    assert "more since" not in finding.remedy
    assert finding.severity is Severity.ERROR


def test_a_silent_bus_is_no_fault_of_the_left_wheel_whatever_an_older_driver_said(facts: RunFacts) -> None:
    """It named the wheel that it looked at first."""
    nothing = replace(facts, wheels=WheelColumns(np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.bool_)))
    at_ns = facts.origin_ns + 1
    events = (
        Event(at_ns, "health", "ready", "ready: encoders starting: left wheel: not heard so far", Severity.INFO),
        Event(at_ns, "encoders", "silent", NO_FRAME, Severity.WARN),
    )
    (finding,) = wheel_findings(replace(nothing, events=events))
    assert (finding.kind, finding.title) == ("odometry_silent", "Both wheel encoders sent nothing in the whole run")


def test_a_bus_that_goes_away_while_driving_is_told_as_that(facts: RunFacts) -> None:
    (finding,) = _told(facts, (4.2, "open", NO_BUS))
    assert finding.title.startswith("Both wheel encoders stopped sending")
    assert (finding.cause, finding.remedy) == tuple(NO_BUS.split("; "))


def test_no_effect_is_told_to_come_before_its_cause() -> None:
    early = Finding("pose_lost", Severity.ERROR, "", (), "", "", ((1.0, 2.0),))
    cause = Finding("laser_silent", Severity.WARN, "", (), "", "", ((3.0, 4.0),))
    assert not ordered([early, cause])[0].follows
    assert ordered([replace(early, intervals=((3.5, 4.5),)), cause])[1].follows == "laser_silent"
