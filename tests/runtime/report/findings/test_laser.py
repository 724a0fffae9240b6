from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from drivers.measurements import Event, Severity
from runtime.report.facts import DeviceClock, RunFacts, ScanColumns
from runtime.report.findings.laser import laser_findings
from tests.support.runtime.seeded_runs import seeded_facts

START_S, END_S = 4.0, 6.0


def _without_scans(facts: RunFacts) -> RunFacts:
    kept = (facts.scans.times_s < START_S) | (facts.scans.times_s > END_S)
    scans = facts.scans
    columns = (scans.times_s, scans.age_s, scans.returned_share, scans.moved_share, scans.near_moved_share)
    why = "nothing came from the laser for 0.5 s; asking again"
    asked = Event(facts.origin_ns + 4_600_000_000, "laser", "silences", why, Severity.WARN)
    return replace(facts, scans=ScanColumns(*(column[kept] for column in columns)), events=(asked,))


def test_a_laser_that_falls_silent_with_the_wheels_does_not_hang(tmp_path: Path) -> None:
    facts = _without_scans(seeded_facts(tmp_path, 1, duration_s=8.0))
    (alone,) = [finding for finding in laser_findings(facts) if finding.kind == "laser_silent"]
    assert "it hangs" in alone.cause
    inside = (facts.wheels.times_s > START_S) & (facts.wheels.times_s < END_S)
    facts = replace(facts, wheels=replace(facts.wheels, valid=facts.wheels.valid & ~inside))
    (together,) = [finding for finding in laser_findings(facts) if finding.kind == "laser_silent"]
    assert "no wheel was heard at that time either" in together.cause


def test_a_laser_that_was_never_reached_did_not_reconnect(tmp_path: Path) -> None:
    made = seeded_facts(tmp_path, 1, duration_s=8.0)
    why = "nothing listens at 10.0.0.9:10940; check the port in laser.url and that the laser has started"
    told = Event(made.origin_ns - 1, "laser", "link_errors", f"{why} (2 more since the last report)", Severity.WARN)
    nothing = ScanColumns(*(np.zeros(0) for _ in fields(ScanColumns)))
    (finding,) = laser_findings(replace(made, scans=nothing, events=(told,)))
    assert (finding.title, finding.severity) == ("The laser sent no usable scan in the whole run", Severity.ERROR)
    assert finding.cause == "there never was a connection: nothing listens at 10.0.0.9:10940"
    assert finding.remedy == "check the port in laser.url and that the laser has started"


def test_scans_that_all_arrived_are_not_called_lost(tmp_path: Path) -> None:
    facts = seeded_facts(tmp_path, 1, duration_s=30.0)
    kept = np.arange(facts.scans.times_s.size) % 5 != 3
    scans = ScanColumns(*(getattr(facts.scans, each.name)[kept] for each in fields(ScanColumns)))
    scans.times_s[0] -= 0.05
    arrivals_s = facts.scans.times_s + 0.03
    used = replace(facts, scans=scans, device_clock=DeviceClock(arrivals_s, arrivals_s))
    (finding,) = [finding for finding in laser_findings(used) if "per second" in finding.title]
    assert (finding.kind, finding.severity) == ("laser_scans_superseded", Severity.INFO)
    assert "8.0 of the laser's 10.0 scans" in finding.title
    assert "lost" not in finding.title + finding.cause
    assert finding.intervals[0][0] >= 0.0  # the first scan was taken before the first tick
    assert "during -" not in finding.evidence[0]
