"""`infant run` on a real CAN stack, with everything that a bus does to it, and the record read afterwards."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.bench.can_bench import BenchUnavailableError, run_bench
from tests.system.bench.run_record import SECOND_NS, BenchRecord, Phase
from tests.system.test_can_bench import FOLDER, RECOVERED_S, WRONG_MM

pytestmark = [pytest.mark.system, pytest.mark.timeout(500)]
LIMIT_S = 400.0
NEAR_M = 0.1  # a pose is unaffected: ten times the error of a drive without trouble, a fifth of what a gap covers
COUNT_MODULUS = 1 << 32
# phase, events of the encoders that must tell of it
TOLD = [
    ("down", {"read": "the interface is down; sudo ip link set vcan0 up", "invalid": "silent"}),
    ("deleted", {"read": "sudo ip link add vcan0 type vcan", "invalid": "silent"}),
    ("bus_off", {"bus_off": "restart-ms", "restarted": "error-active"}),
    ("flood", {"crc": "checksums are wrong"}),
    ("clock", {"clock_jump": "system clock"}),
]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def results(out: Path) -> dict[str, dict[str, Any]]:
    try:
        return run_bench(FOLDER, "run_guest", LIMIT_S, out)
    except BenchUnavailableError as reason:
        pytest.skip(f"no bench: {reason}")


@pytest.fixture(scope="module")
def drive(results: dict[str, dict[str, Any]], out: Path) -> BenchRecord:
    assert results["exit"]["code"] == 0, results
    return BenchRecord(out / "vcan")


def phase(results: dict[str, dict[str, Any]], name: str) -> Phase:
    told = results[f"phase {name}"]
    return Phase(name, told["began_ns"], told["ended_ns"])


def infant(*words: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "runtime.cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["vcan", "slcan"])
def test_it_lives_through_all_of_it_and_ends_in_order_on_a_signal(
    results: dict[str, dict[str, Any]], name: str
) -> None:
    ended = results[name]
    assert ended["alive"], ended
    assert ended["code"] == 0, ended
    assert json.loads(ended["out"])["ticks"] > 50


@pytest.mark.parametrize("name", ["vcan", "slcan"])
def test_its_record_is_whole_and_replays_to_the_last_bit(
    results: dict[str, dict[str, Any]], out: Path, name: str
) -> None:
    assert results[name]["code"] == 0
    verified = infant("log", "verify", out / name)
    assert verified.returncode == 0, verified
    replayed = infant("replay", out / name, "--verify", "--json")
    assert json.loads(replayed.stdout)["identical"], replayed


def test_missed_beats_are_few_and_counted(results: dict[str, dict[str, Any]], drive: BenchRecord) -> None:
    summary = json.loads(results["vcan"]["out"])
    lacking = drive.ticks[-1].tick.seq + 1 - len(drive.ticks)
    assert summary["missed"] == drive.missed() == lacking
    assert lacking < 0.1 * len(drive.ticks), "the guest has one processor and no real time, yet it keeps up"


@pytest.mark.parametrize(("name", "told"), TOLD)
def test_each_trouble_is_an_event_with_its_reason(
    results: dict[str, dict[str, Any]], drive: BenchRecord, name: str, told: dict[str, str]
) -> None:
    events = drive.events_in(phase(results, name), "encoders")
    for kind, words in told.items():
        reasons = [event.reason for event in events if event.kind == kind]
        assert any(words in reason for reason in reasons), (kind, events)


@pytest.mark.parametrize("name", ["down", "deleted"])
def test_the_runs_health_names_the_bus(results: dict[str, dict[str, Any]], drive: BenchRecord, name: str) -> None:
    events = drive.events_in(phase(results, name), "health")
    assert any("encoders failed" in event.reason for event in events), events


@pytest.mark.parametrize("name", ["down", "deleted", "bus_off", "burst", "flood", "clock", "clock_back"])
def test_the_wheels_are_back_within_a_second_and_the_pose_is_where_it_should_be(
    results: dict[str, dict[str, Any]], drive: BenchRecord, name: str
) -> None:
    trouble = phase(results, name)
    worked_off_s = 1.0 if name == "flood" else 0.0  # the reader has to look at every frame before it is over
    assert drive.recovery_s(trouble) < RECOVERED_S + worked_off_s
    after = drive.errors_m(trouble.ended_ns + SECOND_NS, trouble.ended_ns + 3 * SECOND_NS)
    assert after
    assert max(after) < NEAR_M


def test_no_wheel_has_moved_wrongly_and_the_pose_stays_near_the_truth(drive: BenchRecord) -> None:
    assert drive.wrong_wheel_m() * 1000.0 < WRONG_MM
    assert max(drive.errors_m(0, 1 << 62)) < 3.0 * NEAR_M


def test_counts_through_kernel_slcan_are_those_that_were_sent(results: dict[str, dict[str, Any]], out: Path) -> None:
    assert results["adapter"]["noise"] > 3
    sent = json.loads((out / "sent.json").read_text())
    record = BenchRecord(out / "slcan")
    assert record.configuration.encoders is not None
    metres = 1.0 / record.configuration.encoders.counts_per_metre
    good = [sample for sample in record.samples if sample.valid]
    assert len(good) > 100
    stamps = np.array([sample.stamp_ns for sample in good])
    for number, name in ((0x181, "left"), (0x182, "right")):
        rows = np.array([(stamp_ns, count) for stamp_ns, sender, count in sent if sender == number], dtype=np.float64)
        counts = np.unwrap(rows[:, 1], period=COUNT_MODULUS)
        totals = np.array([getattr(sample, name) for sample in good])
        deviation = (totals - np.interp(stamps, rows[:, 0], counts)) * metres
        assert np.ptp(deviation) * 1000.0 < WRONG_MM
