import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import Event, Severity
from runtime.record.trajectories import searched_rows
from runtime.report.facts import QUALITIES
from runtime.report.finding import Finding
from runtime.report.judge import judge, verdict
from tests.support.runtime.confusion import HEALTHY, grave, is_named, said, table_row
from tests.support.runtime.made_drives import Rover
from tests.support.runtime.seeded_runs import FAULTS, Draft, seeded_facts

QUICK = ("laser_silent", "wheel_stuck", "storage_gap", "rate_low", "left_wheel_smaller", "upside_down", "backwards")
SEEDS, HEALTHY_SEEDS = range(5010, 5020), range(4100, 4200)  # none of them was looked at while bounds were chosen


def _found(folder: Path, name: str, seed: int) -> list[Finding]:
    rover, fault, duration_s, _ = FAULTS[name]
    return judge(seeded_facts(folder, seed, rover, fault, duration_s))


def _grave(findings: list[Finding]) -> set[str]:
    return {finding.kind for finding in grave(findings)}


@pytest.mark.parametrize("name", QUICK)
def test_a_seeded_fault_is_named(tmp_path: Path, name: str) -> None:
    findings = _found(tmp_path / name, name, 1)
    assert FAULTS[name][3] in _grave(findings), findings
    assert verdict(findings) != "healthy"


def test_a_healthy_run_has_no_finding_above_info(tmp_path: Path) -> None:
    findings = judge(seeded_facts(tmp_path / "run", 1, Rover()))
    assert not _grave(findings), findings
    assert verdict(findings) == "healthy"


def test_scans_that_are_mirrored_are_the_cause_and_not_the_filter(tmp_path: Path) -> None:
    findings = _found(tmp_path / "run", "upside_down", 3)
    assert findings[0].kind == "laser_mirrored"
    assert findings[0].remedy.startswith("set slam.mount.upside_down = true")
    assert not any("particles" in finding.remedy for finding in findings)


def test_a_hole_in_the_record_is_not_blamed_on_the_sensors(tmp_path: Path) -> None:
    assert _grave(_found(tmp_path / "run", "storage_gap", 2)) == {"storage_gap"}


@pytest.mark.soak
@pytest.mark.parametrize("name", FAULTS)
def test_nine_of_ten_runs_with_a_fault_are_named_right(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [said(name, seed) for seed in SEEDS]
    with capsys.disabled():
        sys.stdout.write("\n" + table_row(name, runs))
    assert sum(is_named(name, run) for run in runs) >= 0.9 * len(runs), runs


@pytest.mark.soak
def test_95_of_100_healthy_runs_have_no_finding_above_info(capsys: pytest.CaptureFixture[str]) -> None:
    runs = [said(HEALTHY, seed) for seed in HEALTHY_SEEDS]
    with capsys.disabled():
        sys.stdout.write("\n" + table_row(HEALTHY, runs))
    assert sum(is_named(HEALTHY, run) for run in runs) >= 0.95 * len(runs), [run for run in runs if run.kinds]


def test_what_happens_while_devices_come_up_is_no_finding(tmp_path: Path) -> None:
    def early(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
        began = Event(drafts[0].stamp_ns - 200_000_000, "encoders", "restart", "left wheel: the node has booted")
        return [replace(drafts[0], events=(began,)), *drafts[1:]]

    assert "wheel_node_restarted" not in _grave(judge(seeded_facts(tmp_path / "run", 1, fault=early, duration_s=6.0)))


def test_the_cause_is_told_before_what_follows_from_it(tmp_path: Path) -> None:
    findings = _found(tmp_path / "run", "laser_restarted", 3)
    kinds = [finding.kind for finding in findings]
    assert kinds[0] == "scan_stamps_jump", kinds
    silent = next(finding for finding in findings if finding.kind == "laser_silent")
    assert silent.follows == "scan_stamps_jump"


def test_a_run_of_two_ticks_is_not_called_healthy(tmp_path: Path) -> None:
    findings = judge(seeded_facts(tmp_path / "run", 1, duration_s=0.2))
    assert _grave(findings) == {"short_run"}
    assert verdict(findings) == "not reliable as it is"


def test_holes_of_a_recording_of_others_are_no_fault_of_a_sensor(tmp_path: Path) -> None:
    rover, fault, duration_s, _ = FAULTS["laser_silent"]
    facts = replace(seeded_facts(tmp_path / "run", 2, rover, fault, duration_s), imported=True, source="replay of it")
    found = {finding.kind: finding.severity for finding in judge(facts)}
    assert found["recording_without_scans"] is Severity.INFO
    assert "laser_silent" not in found


@pytest.mark.parametrize("people", [0, 7])
def test_people_are_told_where_there_are_some(tmp_path: Path, people: int) -> None:
    kinds = {finding.kind for finding in judge(seeded_facts(tmp_path / "run", 6, duration_s=10.0, people=people))}
    assert ("people" in kinds) == (people > 0)


def test_a_pose_that_is_far_off_and_says_it_is_not_is_called_overconfident(tmp_path: Path) -> None:
    facts = seeded_facts(tmp_path / "run", 3, duration_s=8.0)
    assert "overconfident" not in {finding.kind for finding in judge(facts)}
    off = replace(facts, accuracy={**facts.accuracy, "rms_m": 1.2, "trimmed_rms_m": 1.2, "odometry_rms_m": 5.0})
    assert "overconfident" in _grave(judge(off))
    told = replace(off, ticks=replace(facts.ticks, position_sd_m=np.full_like(facts.ticks.position_sd_m, 0.5)))
    assert "overconfident" not in _grave(judge(told))
    quality = np.where(facts.ticks.times_s > 6.0, QUALITIES.index("lost"), facts.ticks.quality)
    assert "overconfident" not in _grave(judge(replace(off, ticks=replace(facts.ticks, quality=quality))))


@pytest.mark.parametrize(("rise_s", "cause"), [(0.0, "was carried, pushed or lifted"), (1.0, "landmarks of the map")])
def test_a_rover_that_was_carried_is_told_from_one_whose_landmarks_are_missed(
    tmp_path: Path, rise_s: float, cause: str
) -> None:
    """One scan says that a rover is not where it was; landmarks that are missed take several."""
    facts = seeded_facts(tmp_path / "run", 3, duration_s=8.0)
    ticks = facts.ticks
    score = np.clip((ticks.times_s - 6.0) / max(rise_s, 1e-9), 0.0, 1.0) * 27.0
    quality = np.where(score >= 18.0, QUALITIES.index("lost"), ticks.quality)
    counts = {**ticks.counts, "doubt_score": score}
    findings = {each.kind: each for each in judge(replace(facts, ticks=replace(ticks, counts=counts, quality=quality)))}
    assert cause in findings["pose_lost"].cause


def test_a_pose_that_is_right_and_claims_to_be_unsure_is_called_underconfident(tmp_path: Path) -> None:
    facts = seeded_facts(tmp_path / "run", 3, duration_s=8.0)
    unsure = replace(facts, ticks=replace(facts.ticks, position_sd_m=np.full_like(facts.ticks.position_sd_m, 0.3)))
    assert "underconfident" not in _grave(judge(facts))
    assert "underconfident" in _grave(judge(unsure))
    right = replace(unsure, accuracy={**facts.accuracy, "rms_m": 0.2, "trimmed_rms_m": 0.2, "odometry_rms_m": 5.0})
    assert "underconfident" not in _grave(judge(right))


@pytest.mark.parametrize("found_s", [6.0, math.inf])
def test_a_run_that_begins_anywhere_in_a_saved_map_is_judged_from_when_its_place_is_known(
    tmp_path: Path, found_s: float
) -> None:
    facts = seeded_facts(tmp_path / "run", 3, duration_s=12.0)
    ticks = facts.ticks
    before = ticks.times_s < found_s
    known = np.where(before, 2.0, 1.0)
    is_new = np.full(ticks.times_s.size, np.nan)
    if math.isfinite(found_s):
        is_new[np.flatnonzero(~before)[0]] = 0.0
    there = np.where(before[:, None], ticks.estimated, ticks.estimated + np.array((40.0, -25.0, 0.0)))
    counts = ticks.counts | {"maps_known": known, "recognised_is_new": is_new, "recognised_map_id": is_new}
    lost = np.where(before, QUALITIES.index("lost"), ticks.quality)
    findings = judge(replace(facts, ticks=replace(ticks, counts=counts, estimated=there, quality=lost)))
    searching = next(finding for finding in findings if finding.kind == "searching")
    if math.isfinite(found_s):
        assert not _grave(findings), findings
        assert f"after {found_s:.1f} s" in searching.title
    else:
        assert _grave(findings) == {"searching"}


def test_poses_of_the_time_before_the_place_is_known_are_in_another_frame() -> None:
    counts = {
        "maps_known": np.array((2.0, 2.0, 2.0, 1.0)),
        "recognised_is_new": np.array((np.nan, np.nan, 0.0, np.nan)),
    }
    assert searched_rows(counts) == 2
    assert searched_rows(counts | {"maps_known": np.ones(4)}) == 0, "a rover that was carried is judged from its start"
    assert searched_rows(counts | {"recognised_is_new": np.array((np.nan, 1.0, np.nan, np.nan))}) == 0
    assert searched_rows({}) == 0
