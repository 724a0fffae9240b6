"""The long drive: its clock, its rover, its figures; a short one by default, five hours of driving under `soak`."""

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.world import World
from runtime.source_tree import ROOT
from runtime.studies.soak.clock import Leap, LeapingClock
from runtime.studies.soak.process_sampler import Sample, fitted_growth, heap_mb
from runtime.studies.soak.scans_ahead import ScansAhead
from runtime.studies.soak.soak import GROWTH_MAX_MB, process_figures

SECOND_NS = 1_000_000_000


def driven(minutes: float, speed: float, out: Path, *words: str) -> dict[str, Any]:
    command = [
        sys.executable,
        "-m",
        "runtime.cli",
        "soak",
        "--config",
        str(ROOT / "config/mock.toml"),
        "--minutes",
        str(minutes),
        "--speed",
        str(speed),
        "--out",
        str(out),
        "--json",
        *words,
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=out.parent)
    assert done.returncode == 0, done.stderr
    measured: dict[str, Any] = json.loads(done.stdout)
    return measured


def samples(resident_mb: list[float], descriptors: list[int] | None = None) -> list[Sample]:
    counts = descriptors or [30] * len(resident_mb)
    return [
        Sample(60.0 * minute, held_mb, held_mb, 10_000, count, 12, 200.0, 50, 0.0)
        for minute, (held_mb, count) in enumerate(zip(resident_mb, counts, strict=True))
    ]


def test_a_sleep_leaps_to_its_end_and_no_faster_than_was_asked() -> None:
    clock = LeapingClock(100.0, lambda _deadline_ns, _leap: None)
    began_ns, real_ns = clock.now_ns(), time.monotonic_ns()
    clock.sleep_until(began_ns + 10 * SECOND_NS)
    assert clock.now_ns() >= began_ns + 10 * SECOND_NS
    assert time.monotonic_ns() - real_ns >= 0.099 * SECOND_NS
    fast = LeapingClock(1e9, lambda _deadline_ns, _leap: None)
    before_ns = fast.now_ns()
    fast.sleep_until(before_ns + 1000 * SECOND_NS)
    assert fast.now_ns() >= before_ns + 1000 * SECOND_NS


def test_work_takes_the_time_that_it_takes() -> None:
    clock = LeapingClock(1e9, lambda _deadline_ns, _leap: None)
    clock.sleep_until(clock.now_ns() + SECOND_NS)
    before_ns, real_ns = clock.now_ns(), time.monotonic_ns()
    while time.monotonic_ns() - real_ns < 20_000_000:
        pass
    assert clock.now_ns() - before_ns >= 20_000_000


def test_what_happens_during_a_sleep_sees_its_own_time_and_a_clock_that_stands() -> None:
    seen: list[tuple[int, int]] = []

    def meanwhile(deadline_ns: int, leap: Leap) -> None:
        for at_ns in (deadline_ns - 5, deadline_ns - 9):  # the second one is late: time does not go back
            leap(at_ns)
            seen.append((clock.now_ns() - deadline_ns, clock.now_ns() - deadline_ns))

    clock = LeapingClock(1e9, meanwhile)
    clock.sleep_until(clock.now_ns() + SECOND_NS)
    assert seen == [(-5, -5), (-5, -5)]


def test_sweeps_that_were_cast_ahead_are_the_worlds_own() -> None:
    settings = WorldSettings()
    world, ahead = World(settings), ScansAhead(settings)
    try:
        times_ns = [5, 100_000_005, 200_000_006, 300_000_006, 9_000_000_000, 9_100_000_000]  # one is off by a rounding
        for t_ns in times_ns:
            cast = ahead.at(t_ns)
            exact = [world.ranges_at(t_ns + off) for off in (-1, 0, 1)]
            assert any(np.array_equal(cast, ranges) for ranges in exact)
        assert np.array_equal(ahead.at(50), world.ranges_at(50))  # not foreseen
    finally:
        ahead.close()


def test_growth_is_fitted_through_what_comes_and_goes() -> None:
    flat = [200.0 + 3.0 * (minute % 7 == 3) for minute in range(60)]
    rising = [held + 0.1 * minute for minute, held in enumerate(flat)]
    assert fitted_growth(samples(flat), flat) == pytest.approx(0.0)
    assert fitted_growth(samples(rising), rising) == pytest.approx(5.9, abs=0.3)


def test_the_heap_is_what_is_held_and_not_what_malloc_keeps() -> None:
    before_mb = heap_mb()
    held = [bytes(100_000) for _ in range(200)]
    assert heap_mb() - before_mb == pytest.approx(20.0, abs=2.0)
    held.clear()
    assert heap_mb() - before_mb < 2.0


def test_warming_up_is_no_leak_and_a_descriptor_a_minute_is_one() -> None:
    warming = process_figures(samples([100.0, 150.0, 190.0] + [200.0] * 57))
    assert warming["growth_mb"] == {"end_minus_settled": 0.0, "fitted": 0.0, "heap_fitted": 0.0}
    assert warming["descriptors_grown"] == 0
    leaking = process_figures(samples([200.0] * 60, list(range(30, 90))))
    assert leaking["descriptors_grown"] > 30


def check_counts(measured: dict[str, Any]) -> None:
    """What has to hold however long the drive is."""
    summary = measured["summary"]
    assert measured["left_open"] == {}
    assert measured["descriptors_grown"] == 0
    assert measured["threads_grown"] <= 0
    assert measured["garbage"] == 0  # the loop switches the collector off: a cycle would stay
    assert measured["damages"] == measured["gaps"] == []
    assert {name: sink["dropped"] for name, sink in measured["sinks"].items()} == dict.fromkeys(measured["sinks"], 0)
    assert summary["slam_rms_m"] < 0.3
    assert summary["sensors"]["laser"]["state"] == summary["sensors"]["encoders"]["state"] == "fresh"
    assert measured["heard"]["infant/mock/pose"] > 0


def test_48_seconds_of_driving_leaves_nothing_open_and_replays_to_the_last_bit(tmp_path: Path) -> None:
    measured = driven(0.04, 20.0, tmp_path / "out", "--set", "record.segment_s=15", "--set", "slam.particles=30")
    check_counts(measured)
    summary = measured["summary"]
    assert summary["ticks"] + summary["missed"] == 480
    segments = measured["segments"]
    assert segments["closed"] == segments["left"] >= 3  # the recorder looks at the leaping clock ten times a second
    assert segments["removed"] == 0
    assert measured["verified_ticks"] == summary["ticks"]
    assert measured["replayed"] == {"whole": True, "ticks": summary["ticks"], "identical": True}


@pytest.mark.soak
@pytest.mark.timeout(3 * 3600)
def test_five_hours_of_driving_leave_nothing_behind(tmp_path: Path) -> None:
    measured = driven(30.0, 10.0, tmp_path / "out")
    samples_kept = measured.pop("samples")
    sys.stdout.write(f"\n{json.dumps(measured)}\n{len(samples_kept)} samples\n")
    check_counts(measured)
    assert measured["summary"]["ticks"] + measured["summary"]["missed"] == 180_000
    assert measured["missed_by_itself"] == 0  # what other programs on this computer take is not the loop's doing
    assert max(measured["growth_mb"].values()) < GROWTH_MAX_MB
    assert measured["heard"]["infant/mock/pose"] > 0.9 * measured["summary"]["ticks"]
    assert measured["segments"]["removed"] > 0
    assert measured["replayed"]["ticks"] > 0
