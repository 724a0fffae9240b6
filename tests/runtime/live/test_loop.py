"""The loop on a clock that obeys: no test sleeps."""

import threading
from collections.abc import Callable

import numpy as np
import pytest

from drivers.measurements import (
    Event,
    Scan,
    ScanLike,
    SensorHealth,
    SensorState,
    WheelCounts,
    WheelSample,
    uniform_bearings,
)
from runtime.health import Health, HealthMonitor
from runtime.live.loop import Inputs, Loop, Outputs
from runtime.live.stage_clock import StageClock
from runtime.tick import CompletedTick, SinkHealth, Tick, Timing
from slam.estimate import Estimate, Quality
from slam.pose import Pose2
from slam.recognise.prior import PosePrior

PERIOD_NS = 100_000_000


class ObedientClock:
    """Time passes only when someone sleeps or works."""

    def __init__(self) -> None:
        self.time_ns = 0

    def now_ns(self) -> int:
        return self.time_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.time_ns = max(self.time_ns, deadline_ns)


class StillSensors:
    """Both sensors at once: a scan when asked to, one wheel sample a drain."""

    def __init__(self, state: SensorState = SensorState.FRESH) -> None:
        self.state = state
        self.scans: list[Scan] = []

    def start(self) -> None: ...

    def latest(self) -> Scan | None:
        return self.scans.pop(0) if self.scans else None

    def drain(self) -> tuple[WheelCounts, ...]:
        return (WheelCounts(0, 0.0, 0.0),)

    def drain_events(self) -> tuple[Event, ...]:
        return ()

    def health(self) -> SensorHealth:
        return SensorHealth(self.state, "as told", 10.0)

    def close(self) -> None: ...


class ThinkingEstimator:
    """Takes the time it is told for each tick."""

    def __init__(self, clock: ObedientClock, think_ns: Callable[[int], int]) -> None:
        self.clock, self.think_ns, self.steps = clock, think_ns, 0

    def step(
        self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
    ) -> Estimate:
        self.clock.time_ns += self.think_ns(self.steps)
        self.steps += 1
        zero = np.zeros((3, 3))
        return Estimate(stamp_ns, Pose2(), zero, Pose2(), zero, Pose2(), Quality.TRACKING)

    def state_hash(self) -> bytes:
        return bytes(16)


class Collector:
    """Keeps what a sink is given."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []
        self.timings: list[Timing] = []
        self.sink_health = SinkHealth(0, 0)

    def put(self, completed: CompletedTick) -> None:
        self.ticks.append(completed.tick)
        self.timings.append(completed.timing)

    def health(self) -> SinkHealth:
        return self.sink_health

    def close(self) -> None: ...


def run_loop(
    think_ns: Callable[[int], int], duration_ns: int, sensors: StillSensors | None = None
) -> tuple[Collector, Loop, list[Health]]:
    clock, sink, seen = ObedientClock(), Collector(), []
    sensors = sensors or StillSensors()

    def watch(_completed: CompletedTick, health: Health) -> None:
        seen.append(health)

    loop = Loop(
        StageClock(clock),
        ThinkingEstimator(clock, think_ns),
        Inputs(sensors, sensors),
        Outputs({"collector": sink}, HealthMonitor(), watch),
        PERIOD_NS,
    )
    loop.run(1000, threading.Event(), duration_ns)
    return sink, loop, seen


def test_beats_lie_on_the_grid_and_fill_the_duration() -> None:
    sink, loop, _ = run_loop(lambda _step: 5_000_000, 10 * PERIOD_NS)
    assert [tick.stamp_ns for tick in sink.ticks] == [1000 + k * PERIOD_NS for k in range(10)]
    assert loop.timekeeping.missed == 0
    assert loop.timekeeping.rate_hz == pytest.approx(10.0)


def test_an_overslept_beat_is_skipped_counted_recorded_and_never_bunched_up() -> None:
    sink, loop, _ = run_loop(lambda step: 350_000_000 if step == 2 else 0, 10 * PERIOD_NS)
    assert [tick.seq for tick in sink.ticks] == [0, 1, 2, 6, 7, 8, 9]
    assert loop.timekeeping.missed == 3
    assert loop.timekeeping.rate_hz < 8.0
    assert loop.timekeeping.beat_hz == pytest.approx(10.0, abs=1e-9), "missed beats are beats too"
    assert [timing.missed for timing in sink.timings] == [0, 0, 0, 3, 0, 0, 0]
    late = next(tick for tick in sink.ticks if tick.seq == 6)
    assert any(event.kind == "missed" and "3 beat(s)" in event.reason for event in late.events)


def test_a_beat_that_takes_exactly_its_period_misses_the_one_it_covers() -> None:
    sink, _, _ = run_loop(lambda step: PERIOD_NS if step == 0 else 0, 4 * PERIOD_NS)
    assert [tick.seq for tick in sink.ticks] == [0, 2, 3]


def test_the_loop_stops_when_told() -> None:
    clock, stop = ObedientClock(), threading.Event()
    sensors, sink = StillSensors(), Collector()

    def watch(completed: CompletedTick, _health: Health) -> None:
        if completed.tick.seq == 4:
            stop.set()

    Loop(
        StageClock(clock),
        ThinkingEstimator(clock, lambda _s: 0),
        Inputs(sensors, sensors),
        Outputs({"c": sink}, HealthMonitor(), watch),
        PERIOD_NS,
    ).run(0, stop, 100 * PERIOD_NS)
    assert len(sink.ticks) == 5


def test_each_scan_is_handed_out_once_and_a_tick_without_one_goes_on() -> None:
    sensors = StillSensors()
    sensors.scans = [Scan(0, np.zeros(3, np.float32), uniform_bearings(-1.0, 1.0, 3))]
    sink, _, _ = run_loop(lambda _step: 0, 3 * PERIOD_NS, sensors)
    assert [tick.scan is not None for tick in sink.ticks] == [True, False, False]


def test_a_silent_sensor_degrades_the_run_with_its_reason_once() -> None:
    sink, _, seen = run_loop(lambda _step: 0, 5 * PERIOD_NS, StillSensors(SensorState.STALE))
    assert {health.state for health in seen} == {"degraded"}
    assert "laser stale: as told" in seen[0].reasons
    changes = [event for tick in sink.ticks for event in tick.events if event.source == "health"]
    assert len(changes) == 1
    assert "laser stale" in changes[0].reason


def test_a_defect_in_the_estimator_is_contained_and_recorded() -> None:
    class Defective(ThinkingEstimator):
        def step(
            self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
        ) -> Estimate:
            if scan is not None:
                raise FloatingPointError("covariance is not positive")
            return super().step(stamp_ns, scan, wheels)

    clock, sensors, sink = ObedientClock(), StillSensors(), Collector()
    sensors.scans = [Scan(0, np.zeros(3, np.float32), uniform_bearings(-1.0, 1.0, 3))]
    Loop(
        StageClock(clock),
        Defective(clock, lambda _s: 0),
        Inputs(sensors, sensors),
        Outputs({"c": sink}, HealthMonitor(), lambda *_: None),
        PERIOD_NS,
    ).run(0, threading.Event(), 3 * PERIOD_NS)
    assert len(sink.ticks) == 3
    defects = [event for tick in sink.ticks for event in tick.events if event.kind == "defect"]
    assert len(defects) == 1
    assert "covariance is not positive" in defects[0].reason


def test_an_overrun_names_the_stage_that_caused_it_and_stages_are_timed() -> None:
    sink, loop, _ = run_loop(lambda step: 350_000_000 if step == 2 else 1_000_000, 10 * PERIOD_NS)
    late = next(tick for tick in sink.ticks if tick.seq == 6)
    reasons = [event.reason for event in late.events if event.kind == "missed"]
    assert reasons == ["3 beat(s) before tick 6 missed: estimate took 350 ms"]
    assert sink.timings[0].stages_ns["step"] == 1_000_000
    assert {"read", "estimate", "hand to collector", "health", "status"} <= set(sink.timings[1].stages_ns)
    assert loop.timekeeping.stages["step"].spread() == {"p50": 1.01, "p99": 350.0, "max": 350.0}


def test_the_estimators_own_stages_stand_in_the_timing() -> None:
    clock, sensors, sink = ObedientClock(), StillSensors(), Collector()
    stages = StageClock(clock)

    class Marking(ThinkingEstimator):
        def step(
            self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
        ) -> Estimate:
            self.clock.time_ns += 2_000_000
            stages.mark("front end")
            return super().step(stamp_ns, scan, wheels)

    Loop(
        stages,
        Marking(clock, lambda _s: 3_000_000),
        Inputs(sensors, sensors),
        Outputs({"c": sink}, HealthMonitor(), lambda *_: None),
        PERIOD_NS,
    ).run(0, threading.Event(), PERIOD_NS)
    taken = sink.timings[0].stages_ns
    assert (taken["front end"], taken["estimate"], taken["step"]) == (2_000_000, 3_000_000, 5_000_000)


def test_a_sink_that_raises_loses_its_tick_and_not_the_run() -> None:
    class Broken(Collector):
        def put(self, completed: CompletedTick) -> None:
            raise RuntimeError("no room")

    clock, sensors, sink = ObedientClock(), StillSensors(), Collector()
    Loop(
        StageClock(clock),
        ThinkingEstimator(clock, lambda _s: 0),
        Inputs(sensors, sensors),
        Outputs({"broken": Broken(), "c": sink}, HealthMonitor(), lambda *_: None),
        PERIOD_NS,
    ).run(0, threading.Event(), 3 * PERIOD_NS)
    assert len(sink.ticks) == 3
    assert any(event.source == "broken" and "no room" in event.reason for event in sink.ticks[1].events)
