"""The service as it is installed, under a real systemd with a real CAN interface: what a field does to it.

The bench is a kernel of its own in a process (tests/system/bench/systemd_bench.py). It takes four minutes on an idle
machine of two cores, the first time two more to compile the filter's kernels in there. `make system` runs it.
"""

import os
from pathlib import Path
from typing import Any

import pytest

from tests.system.bench.can_bench import BenchUnavailableError
from tests.system.bench.systemd_bench import run_service_bench

pytestmark = [pytest.mark.system, pytest.mark.timeout(2400)]
FOLDER = Path(os.environ.get("INFANT_BENCH", Path.home() / ".cache" / "infant-bench"))
STARTS = 30  # StartLimitBurst of the unit
Results = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def results() -> Results:
    FOLDER.mkdir(parents=True, exist_ok=True)
    try:
        return run_service_bench(FOLDER)
    except BenchUnavailableError as reason:
        pytest.skip(f"no bench: {reason}")


def ended_clean(result: dict[str, Any]) -> bool:
    facts = result["facts"]
    return (facts["Result"], facts["ActiveState"], facts["ExecMainStatus"]) == ("success", "inactive", "0")


def reads_up_to_its_end(result: dict[str, Any]) -> bool:
    """A record that was cut off says so, and is damaged nowhere else."""
    said = result["verified"]["said"]
    return result["verified"]["code"] == 6 and said.count("the recording was cut off") == 1 and "1 finding(s)" in said


def test_it_is_installed_once_and_the_second_time_nothing_changes(results: Results) -> None:
    found = results["installation"]
    assert found["codes"] == [0, 0], found["said"]
    assert found["states"] == [["kept", "new"], ["kept", "unchanged"]]
    assert found["kept"], "the configuration of the engineer"
    assert found["enabled"] == "enabled"
    assert "dialout" in found["user"]


def test_it_runs_with_its_privileges_and_without_a_restart(results: Results) -> None:
    found = results["ordinary"]
    assert found["ready_s"] >= 0.0
    assert found["fifo"] == [True], "the loop's thread and no other is a real-time thread"
    assert found["locked_kb"] > 100_000
    assert found["facts"]["NRestarts"] == "0", found["journal"]
    assert "no real-time priority" not in found["journal"]
    assert "the drawing process has ended" not in found["facts"]["StatusText"]


def test_a_bus_that_goes_away_and_comes_back_is_a_state_and_no_restart(results: Results) -> None:
    found = results["bus"]
    assert found["lost_s"] >= 0.0
    assert "encoders failed" in found["said"]
    assert "sudo ip link add vcan0 type vcan" in found["said"]
    assert found["back_s"] >= 0.0
    assert found["same"], "the process is the same"
    assert found["facts"]["NRestarts"] == "0"


def test_sigterm_ends_it_with_a_whole_record_and_its_summary(results: Results) -> None:
    found = results["sigterm"]
    assert ended_clean(found), found["facts"]
    assert found["verified"]["code"] == 0, found["verified"]["said"]
    assert found["summary"]["ticks"] > 50


def test_a_loop_that_hangs_is_killed_by_the_watchdog_and_started_again(results: Results) -> None:
    found = results["loop_hangs"]
    assert 0.0 <= found["killed_s"] < 15.0
    assert "Watchdog timeout (limit 2s)!" in found["journal"]
    assert found["restarts"] == 1
    assert found["back_s"] >= 0.0
    assert found["lost_s"] < 0.5, "the record reaches to where the loop hung"
    assert reads_up_to_its_end(found), found["verified"]


def test_a_reader_that_hangs_is_named_and_ends_in_a_restart_while_the_loop_goes_on(results: Results) -> None:
    found = results["reader_hangs"]
    assert 30.0 <= found["killed_s"] < 60.0
    assert "the watchdog is no longer fed" in found["journal"]
    assert "Watchdog timeout (limit 2s)!" in found["journal"]
    assert found["restarts"] == 1
    assert found["back_s"] >= 0.0
    assert found["lost_s"] < -25.0, "the loop went on for as long as the watchdog was fed"
    assert reads_up_to_its_end(found), found["verified"]


def test_a_crash_loop_ends_at_the_start_limit_and_can_be_begun_again(results: Results) -> None:
    found = results["crashes"]
    assert STARTS <= found["starts"] <= STARTS + 1, "one of them may have run before"
    assert "Start request repeated too quickly." in found["journal"]
    assert found["facts"]["ActiveState"] == "failed"
    assert found["again_s"] >= 0.0


def test_one_that_never_gets_ready_is_ended_and_started_again(results: Results) -> None:
    found = results["never_ready"]
    assert 0.0 <= found["gone_s"] < 30.0
    assert "start operation timed out" in found["journal"]
    assert found["back_s"] >= 0.0


def test_a_bad_configuration_is_said_in_the_journal_and_not_tried_again(results: Results) -> None:
    found = results["bad_configuration"]
    assert found["facts"]["ExecMainStatus"] == "3"
    assert found["facts"]["ActiveState"] == "failed"
    assert found["facts"]["NRestarts"] == "0"
    sentence = "/etc/infant/rover.toml: encoders.bus.bit_rate = 'fast': unknown key; did you mean bitrate?"
    assert sentence in found["journal"]


def test_after_a_loss_of_power_it_starts_by_itself_and_the_record_reaches_to_the_last_sync(results: Results) -> None:
    found = results["power_is_back"]
    assert found["by_itself_s"] >= 0.0
    assert found["facts"]["ActiveState"] == "active"
    assert found["lost_s"] < 2.0, "a sync a second, chunks of 0.3 s, and a disk that takes its time"
    assert reads_up_to_its_end(found), found["verified"]
