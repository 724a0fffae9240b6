"""The loop: read, step, hand on, sleep until the next point of a fixed grid."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from drivers.measurements import Encoders, Event, Laser, SensorHealth, Severity
from runtime.fault_isolation import Stepping, put_or_report, step_or_predict
from runtime.health import Health, HealthMonitor
from runtime.live.stage_clock import StageClock, slowest
from runtime.live.timekeeping import Timekeeping
from runtime.tick import CompletedTick, Sink, SinkHealth, Tick, Timing
from slam.pose import Pose2

Watch = Callable[[CompletedTick, Health], None]

ASLEEP = "waking up"


class Beat(NamedTuple):
    """A point of the grid: number, time, how late the loop woke up, and beats that were skipped before it."""

    seq: int
    stamp_ns: int
    lateness_ns: int
    missed: int


@dataclass(frozen=True, slots=True)
class Inputs:
    """What the loop reads: both sensors, events from elsewhere (commands), and a simulator's truth at a stamp."""

    laser: Laser
    encoders: Encoders
    drain_events: Callable[[], tuple[Event, ...]] = tuple
    truth: Callable[[int], Pose2 | None] = lambda _stamp_ns: None

    def tick(self, beat: Beat, carried: tuple[Event, ...]) -> Tick:
        """All that came in until now; carried: events of the loop itself."""
        events = carried + self.laser.drain_events() + self.encoders.drain_events() + self.drain_events()
        return Tick(beat.seq, beat.stamp_ns, self.laser.latest(), self.encoders.drain(), events)

    def health(self) -> dict[str, SensorHealth]:
        """How both sensors are."""
        return {"laser": self.laser.health(), "encoders": self.encoders.health()}


@dataclass(frozen=True, slots=True)
class Outputs:
    """What the loop hands on to: sinks by name, the monitor that concludes the health, and who watches both."""

    sinks: Mapping[str, Sink]
    monitor: HealthMonitor
    watch: Watch

    def health(self) -> dict[str, SinkHealth]:
        """How all sinks are."""
        return {name: sink.health() for name, sink in self.sinks.items()}


class Loop:
    """Runs the estimator on a fixed grid of beats; a beat that is overslept is skipped, counted and recorded.

    Nothing in here waits for a sensor, a file or a network: the sensors hand out what they have, the sinks queue.
    stages: the clock of the loop, on which the estimator marks its own stages too.
    """

    def __init__(
        self, stages: StageClock, estimator: Stepping, inputs: Inputs, outputs: Outputs, period_ns: int
    ) -> None:
        self.timekeeping = Timekeeping()
        self._stages = stages
        self._clock = stages.clock
        self._estimator = estimator
        self._inputs = inputs
        self._outputs = outputs
        self._period_ns = period_ns
        self._after_ns: dict[str, int] = {}

    def run(self, start_ns: int, stop: threading.Event, duration_ns: int, events: tuple[Event, ...] = ()) -> None:
        """Beat from start_ns until `stop` is set or the duration has passed; events: for the first tick."""
        seq, missed = 0, 0
        while not stop.is_set() and seq * self._period_ns < duration_ns:
            beat_ns = start_ns + seq * self._period_ns
            self._clock.sleep_until(beat_ns)
            beat = Beat(seq, beat_ns, self._clock.now_ns() - beat_ns, missed)
            events = self._take_beat(beat, events)
            missed = max(0, (self._clock.now_ns() - beat_ns) // self._period_ns)
            if missed:
                events += (self._overrun(beat, missed),)
            seq += 1 + missed

    def _take_beat(self, beat: Beat, carried: tuple[Event, ...]) -> tuple[Event, ...]:
        """One tick; returns the events that belong into the next one."""
        stages, outputs = self._stages, self._outputs
        stages.begin()
        with stages.stage("read"):
            tick = self._inputs.tick(beat, carried)
        with stages.stage("estimate"):
            estimate, events = step_or_predict(self._estimator, tick)
            state_hash = self._estimator.state_hash()
        before_ns = stages.durations_ns()
        step_ns = sum(before_ns.values()) - before_ns["read"]
        timing = Timing(beat.lateness_ns, beat.missed, {"step": step_ns, **before_ns, **self._after_ns})
        with stages.stage("truth"):
            true_pose = self._inputs.truth(estimate.stamp_ns)
            defect = "; ".join(event.reason for event in events)
            completed = CompletedTick(tick, estimate, timing, state_hash, true_pose, defect)
        for name, sink in outputs.sinks.items():
            with stages.stage(f"hand to {name}"):
                events += put_or_report(name, sink, completed)
        with stages.stage("health"):
            health, changes = outputs.monitor.assess(tick.stamp_ns, self._inputs.health(), outputs.health(), estimate)
        with stages.stage("status"):
            outputs.watch(completed, health)
        self._note(beat, timing, before_ns)
        return events + changes

    def _note(self, beat: Beat, timing: Timing, before_ns: dict[str, int]) -> None:
        """Keep time of the whole tick, its stages as they are recorded; before_ns: those up to the estimate."""
        durations_ns = self._stages.durations_ns()
        took_ns = sum(durations_ns.values())
        self._after_ns = {name: took for name, took in durations_ns.items() if name not in before_ns}
        self.timekeeping.note(beat.stamp_ns, beat.lateness_ns, beat.missed, took_ns)
        self.timekeeping.note_stages(timing.stages_ns, took_ns - sum(before_ns.values()))

    def _overrun(self, beat: Beat, missed: int) -> Event:
        """Which stage of this tick kept the loop from the beats after it."""
        name, took_ns = slowest({ASLEEP: beat.lateness_ns, **self._stages.durations_ns()})
        next_seq = beat.seq + 1 + missed
        reason = f"{missed} beat(s) before tick {next_seq} missed: {name} took {took_ns * 1e-6:.0f} ms"
        return Event(beat.stamp_ns, "loop", "missed", reason, Severity.WARN)
