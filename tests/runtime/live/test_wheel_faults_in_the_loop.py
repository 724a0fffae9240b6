"""Faults of the wheels, alone and together with the laser's, in a whole run: it goes on, and says what is wrong."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from drivers.measurements import SensorState
from tests.support.runtime.live_laser import LiveRun, events_of, live_run, missed_beats, recorded

POLL_S = 0.02
RECOVERY_S = 2.0
STALLED_S = 0.1  # five beats of the node: longer than its jitter by far

# counters of which one must tell, state that must show meanwhile (None: too short or too small for one), the fault
FAULTS: dict[str, tuple[tuple[str, ...], SensorState | None, dict[str, Any]]] = {
    "loss": (("left.lost",), None, {"probability": 0.5, "duration_s": 0.6}),
    "duplicate": (("left.duplicate",), None, {"probability": 0.5, "duration_s": 0.5}),
    "reorder": (("left.out_of_order",), None, {"probability": 0.5, "duration_s": 0.5}),
    "bad_crc": (("left.crc",), SensorState.FAILED, {"duration_s": 2.0}),
    "bad_length": (("left.length",), SensorState.FAILED, {"duration_s": 2.0}),
    "remote": (("left.remote",), SensorState.FAILED, {"duration_s": 2.0}),
    "alive_frozen": (("left.alive_frozen",), SensorState.FAILED, {"duration_s": 2.0}),
    "second_sender": (("left.two_senders",), None, {"value": 1, "duration_s": 0.5}),
    "silence": (("left.lost",), SensorState.FAILED, {"duration_s": 2.0}),
    "silence_all": (("bus.lost_together",), SensorState.FAILED, {"wheel": "both", "duration_s": 2.0}),
    "status": (("left.status",), SensorState.FAILED, {"value": 2, "duration_s": 2.0}),
    "jump": (("left.jump", "left.speed_disagrees"), None, {"magnitude": 5000, "duration_s": 0.3}),
    "power_cycle": (("left.power_cycle",), None, {"duration_s": 0.3}),
    "bus_off": (("bus.bus_off",), SensorState.FAILED, {"wheel": "both", "duration_s": 2.0}),
    "error_passive": (("bus.passive",), None, {"wheel": "both", "duration_s": 0.3}),
    "error_flood": (("bus.bus_error",), SensorState.FAILED, {"wheel": "both", "duration_s": 2.0}),
}


def wheels_counted(run: LiveRun, counters: tuple[str, ...]) -> int:
    told = run.parts.encoders.health().counters
    return sum(told.get(counter, 0) for counter in counters)


def await_wheels(run: LiveRun, wanted: SensorState, within_s: float) -> None:
    until_s = time.monotonic() + within_s
    while (health := run.parts.encoders.health()).state is not wanted:
        assert run.thread.is_alive(), "the run has ended by itself"
        assert time.monotonic() < until_s, f"not {wanted} within {within_s} s: {health}"
        time.sleep(POLL_S)


def strike(run: LiveRun, name: str, within_s: float = 600.0) -> float:
    """Inject, wait for its counter and its state; returns seconds from its end until both wheels are heard again.

    A short fault can pass while other programs keep the node from sending at all; only then it is injected again.
    """
    counters, state, values = FAULTS[name]
    until_s = time.monotonic() + within_s
    while True:
        await_wheels(run, SensorState.FRESH, within_s)
        counted = wheels_counted(run, counters)
        run.rover.inject("wheels", {"kind": name, **values})
        end_s = time.monotonic() + float(values["duration_s"])
        if state is not None:
            await_wheels(run, state, within_s)
        if await_count(run, counters, counted, end_s):
            break
        assert time.monotonic() < until_s, f"{name}: none of {counters} counted: {run.parts.encoders.health()}"
    time.sleep(max(0.0, end_s - time.monotonic()))  # the fault lasts so long: nothing to wait for but time
    await_wheels(run, SensorState.FRESH, within_s)
    return time.monotonic() - end_s


def await_count(run: LiveRun, counters: tuple[str, ...], counted: int, end_s: float) -> bool:
    """Whether the fault was counted; fails where it was not though frames came all the time."""
    longest_s, looked_s = 0.0, time.monotonic()
    while wheels_counted(run, counters) == counted:
        age_s, now_s = run.parts.encoders.health().figures.get("left_age_s", 0.0), time.monotonic()
        longest_s = max(longest_s, age_s, now_s - looked_s)
        looked_s = now_s
        if now_s > end_s + 1.0:
            assert longest_s > STALLED_S, f"none of {counters} counted: {run.parts.encoders.health()}"
            return False
        time.sleep(POLL_S)
    return True


def test_faults_of_the_wheels_alone_and_with_the_lasers_are_states_and_never_the_end(tmp_path: Path) -> None:
    with live_run(tmp_path / "run") as run:
        strike(run, "silence")
        strike(run, "bad_crc")
        run.rover.inject("laser", {"kind": "silence", "duration_s": 2.0})
        strike(run, "bus_off")
        run.await_more("scans", 25, 600.0)  # its end has settled
    ticks = recorded(run.folder)
    assert all(each.estimate is not None for each in ticks)
    assert events_of(ticks, "estimator", "defect") == []
    told = " ".join(event.reason for event in events_of(ticks, "health"))
    assert told.count("encoders failed: left wheel: silent") + told.count("encoders failed") >= 3
    assert "laser stale" in told
    assert {event.kind for event in events_of(ticks, "health")} >= {"degraded", "running"}


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_every_fault_of_the_wheels_ten_times_in_one_run(tmp_path: Path) -> None:
    slowest_s: dict[str, float] = {}
    with live_run(tmp_path / "run") as run:
        for name in FAULTS:
            slowest_s[name] = max(strike(run, name) for _ in range(10))
    ticks = recorded(run.folder)
    rows = [{"fault": name, "injected": 10, "slowest_s": round(took_s, 2)} for name, took_s in slowest_s.items()]
    sys.stdout.write("\n" + "\n".join(json.dumps(row) for row in rows))
    sys.stdout.write(f"\n{len(ticks)} ticks, {missed_beats(ticks)} missed\n")
    assert all(each.estimate is not None for each in ticks)
    assert missed_beats(ticks) == sum(each.timing.missed for each in ticks if each.timing is not None)
    assert events_of(ticks, "estimator", "defect") == []
    assert max(slowest_s.values()) < RECOVERY_S
