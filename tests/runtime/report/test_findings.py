from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import Event, Severity
from runtime.report.finding import Finding
from runtime.report.judge import judge, verdict
from tests.runtime.calibrate.made_drives import Rover
from tests.runtime.report.seeded_runs import FAULTS, Draft, seeded_facts

QUICK = ("laser_silent", "wheel_stuck", "storage_gap", "rate_low", "left_wheel_smaller")
SEEDS = range(10, 20)


def _found(folder: Path, name: str, seed: int) -> list[Finding]:
    rover, fault, duration_s, _ = FAULTS[name]
    return judge(seeded_facts(folder, seed, rover, fault, duration_s))


def _grave(findings: list[Finding]) -> set[str]:
    return {finding.kind for finding in findings if finding.severity is not Severity.INFO}


@pytest.mark.parametrize("name", QUICK)
def test_a_seeded_fault_is_named(tmp_path: Path, name: str) -> None:
    findings = _found(tmp_path / name, name, 1)
    assert FAULTS[name][3] in _grave(findings), findings
    assert verdict(findings) != "healthy"


def test_a_healthy_run_has_no_finding_above_info(tmp_path: Path) -> None:
    findings = judge(seeded_facts(tmp_path / "run", 1, Rover()))
    assert not _grave(findings), findings
    assert verdict(findings) == "healthy"


def test_a_hole_in_the_record_is_not_blamed_on_the_sensors(tmp_path: Path) -> None:
    assert _grave(_found(tmp_path / "run", "storage_gap", 2)) == {"storage_gap"}


@pytest.mark.soak
@pytest.mark.parametrize("name", FAULTS)
def test_nine_of_ten_runs_with_a_fault_are_named_right(tmp_path: Path, name: str) -> None:
    missed = [seed for seed in SEEDS if FAULTS[name][3] not in _grave(_found(tmp_path / str(seed), name, seed))]
    assert len(missed) <= 0.1 * len(SEEDS), missed


@pytest.mark.soak
def test_95_of_100_healthy_runs_have_no_finding_above_info(tmp_path: Path) -> None:
    told = {seed: _grave(judge(seeded_facts(tmp_path / str(seed), seed, Rover()))) for seed in range(100, 200)}
    assert sum(map(bool, told.values())) <= 5, {seed: kinds for seed, kinds in told.items() if kinds}


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


def test_holes_of_a_recording_of_others_are_no_fault_of_a_sensor(tmp_path: Path) -> None:
    rover, fault, duration_s, _ = FAULTS["laser_silent"]
    facts = replace(seeded_facts(tmp_path / "run", 2, rover, fault, duration_s), imported=True, source="replay of it")
    found = {finding.kind: finding.severity for finding in judge(facts)}
    assert found["recording_without_scans"] is Severity.INFO
    assert "laser_silent" not in found
