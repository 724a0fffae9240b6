"""Every fault of the laser in a whole run: the loop goes on, the reason stands in the record, scans come again."""

import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from drivers.measurements import Event
from drivers.settings.simulated_laser import FaultKind
from runtime.messages.recorded_tick import RecordedTick
from tests.support.runtime.live_laser import LiveRun, events_of, live_run, missed_beats, recorded, told

RECOVERY_S = 2.0
REBOOT_S = 0.3  # reboot_disconnect_s + boot_s of the simulated laser

# fault, the counter and event kind under which the driver must have it, and s from injection until it is over
FAULTS: dict[str, tuple[dict[str, Any], str, float]] = {
    "off": ({"kind": "off", "duration_s": 0.5}, "link_errors", 0.7),  # then it boots
    "stuck": ({"kind": "stuck", "duration_s": 1.5}, "frozen_scans", 1.5),
    "garbage": ({"kind": "garbage", "duration_s": 0.8}, "garbage", 0.8),
    "wrong": ({"kind": "wrong", "duration_s": 0.5}, "wrong_size", 0.5),
    "slow": ({"kind": "slow", "duration_s": 0.8, "keep_every": 4}, "dropped_scans", 0.8),
    "delayed": ({"kind": "delayed", "duration_s": 0.8, "delay_s": 0.3}, "late_scans", 0.8),
    "intermittent": ({"kind": "intermittent", "duration_s": 0.8, "loss": 0.8}, "dropped_scans", 0.8),
    "cut": ({"kind": "cut", "duration_s": 0.5}, "link_errors", 0.5),
    "power_cycle": ({"kind": "power_cycle"}, "link_errors", 0.2),
    "half_message": ({"kind": "half_message", "duration_s": 0.8}, "garbage", 0.8),
    "bad_checksum": ({"kind": "bad_checksum", "duration_s": 0.5}, "checksum_errors", 0.5),
    "silence": ({"kind": "silence", "duration_s": 1.0}, "silences", 1.0),
    "status_0L": ({"kind": "status", "status": "0L"}, "malfunctions", REBOOT_S),  # the driver's reboot ends it
    "status_0M": ({"kind": "status", "status": "0M", "duration_s": 0.5}, "status_0M", 0.5),
    "status_66": ({"kind": "status", "status": "66"}, "malfunctions", REBOOT_S),
    "stale_stamp": ({"kind": "stale_stamp", "duration_s": 0.5}, "stale_stamp", 0.5),
    "clock_reset": ({"kind": "clock_reset"}, "clock_restarts", 0.0),
}


def check_record(ticks: list[RecordedTick], run: LiveRun, strikes: dict[str, int]) -> None:
    """What a reviewer finds: a tick with an estimate for every beat that was kept, and every fault with its reason."""
    assert all(each.estimate is not None for each in ticks)
    # a beat that was overslept is told by the tick after it: no tick is lost without a word
    assert missed_beats(ticks) == sum(each.timing.missed for each in ticks if each.timing is not None)
    assert events_of(ticks, "estimator", "defect") == []
    assert run.count("defects") == 0
    for kind, times in strikes.items():
        events = events_of(ticks, "laser", kind)
        assert told(events) >= times, f"{kind}: {times} faults, but the record tells of {told(events)}"
        assert all(event.reason for event in events)


def test_every_kind_of_fault_is_tried_in_the_loop() -> None:
    assert {fault["kind"] for fault, _, _ in FAULTS.values()} == {str(kind) for kind in FaultKind}


def test_faults_do_not_stop_the_loop_and_stand_in_its_record(tmp_path: Path) -> None:
    strikes = ("bad_checksum", "power_cycle", "status_0L", "bad_checksum")
    with live_run(tmp_path / "run") as run:
        for name in strikes:
            run.strike(*FAULTS[name])
        run.await_more("scans", 3, 600.0)
    counters = [FAULTS[name][1] for name in strikes]
    check_record(recorded(run.folder), run, {counter: counters.count(counter) for counter in counters})


def is_stale(event: Event) -> bool:
    return "laser stale: no scan" in event.reason


def silences(ticks: list[RecordedTick]) -> list[list[RecordedTick]]:
    """Stretches without a scan that were told, between ticks with one, each with the tick before.

    Others that a busy machine adds to those of the test are judged alike.
    """
    having = [place for place, each in enumerate(ticks) if each.tick.scan is not None]
    stretches = [ticks[first:last] for first, last in pairwise(having)]
    return [each for each in stretches if any(map(is_stale, events_of(each[1:], "health")))]


def test_a_silence_is_stale_and_the_pose_goes_on_from_odometry(tmp_path: Path) -> None:
    with live_run(tmp_path / "run") as run:
        run.await_more("scans", 25, 600.0)  # the rover rests for two seconds, then it drives
        for _ in range(2):
            run.strike(*FAULTS["silence"])
            run.await_more("scans", 25, 600.0)  # its end has settled: the next is another one
    quiet = silences(recorded(run.folder))
    assert len(quiet) >= 2
    driven_m = []
    for heard, *unheard in quiet:
        assert heard.tick.scan is not None
        # the change is concluded after a tick and told with the next one, stamped with its own beat
        stale = list(filter(is_stale, events_of(unheard, "health")))
        again = {event.reason.split(":")[1] for event in stale[1:]}
        assert len(again) == len(stale) - 1, "told twice for the same reason"
        first, last = heard.estimate, unheard[-1].estimate
        assert first is not None
        assert last is not None
        by_odometry = first.odom_from_body.inverse() @ last.odom_from_body
        by_map = first.map_from_body.inverse() @ last.map_from_body
        driven_m.append(abs(by_odometry.x_m))
        assert by_map.x_m == pytest.approx(by_odometry.x_m, abs=0.02)
        assert by_map.heading_rad == pytest.approx(by_odometry.heading_rad, abs=0.02)
        assert last.covariance.trace() > first.covariance.trace() or driven_m[-1] == 0.0
    assert sum(driven_m) > 0.2, "the rover did not drive"


@pytest.mark.soak
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", FAULTS)
def test_a_hundred_of_a_fault_do_not_stop_the_loop(name: str, tmp_path: Path) -> None:
    fault, counter, over_s = FAULTS[name]
    with live_run(tmp_path / "run") as run:
        recoveries = [run.strike(fault, counter, over_s) for _ in range(100)]
        run.await_more("scans", 12, 600.0)
        counted = run.count(counter)
    ticks = recorded(run.folder)
    row = {
        "fault": name,
        "injected": 100,
        "counted": counted,
        "told": told(events_of(ticks, "laser", counter)),
        "slowest_s": round(max(recoveries), 2),
        "ticks": len(ticks),
        "missed": missed_beats(ticks),
    }
    sys.stdout.write(f"\n{json.dumps(row)}\n")
    check_record(ticks, run, {counter: 100})
    assert max(recoveries) < RECOVERY_S
