"""The loop: read, step, hand on, sleep until the next point of a fixed grid."""

import threading
from collections.abc import Callable, Mapping

from drivers.measurements import Encoders, Event, Laser, Severity
from runtime.containment import Stepping, contained_put, contained_step
from runtime.health import Health, HealthMonitor
from runtime.live.clock import Clock
from runtime.live.stage_clock import StageClock, slowest
from runtime.live.timekeeping import Timekeeping
from runtime.tick import Sink, Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

Truth = Callable[[int], Pose2 | None]
Watch = Callable[[Tick, Estimate, Timing, Health], None]

ASLEEP = "waking up"


class Loop:
    """Runs the estimator on a fixed grid of beats; a beat that is overslept is skipped, counted and recorded.

    Nothing in here waits for a sensor, a file or a network: the sensors hand out what they have, the sinks queue.
    stages: the clock that the estimator marks its stages on, where it does.
    """

    def __init__(
        self,
        clock: Clock,
        laser: Laser,
        encoders: Encoders,
        estimator: Stepping,
        sinks: Mapping[str, Sink],
        monitor: HealthMonitor,
        period_ns: int,
        truth: Truth,
        watch: Watch,
        commands: Callable[[], tuple[Event, ...]] = tuple,
        stages: StageClock | None = None,
    ) -> None:
        self.timekeeping = Timekeeping()
        self._clock = clock
        self._laser = laser
        self._encoders = encoders
        self._estimator = estimator
        self._sinks = sinks
        self._monitor = monitor
        self._period_ns = period_ns
        self._truth = truth
        self._watch = watch
        self._commands = commands
        self._stages = StageClock(clock) if stages is None else stages
        self._after_ns: dict[str, int] = {}

    def run(self, start_ns: int, stop: threading.Event, duration_ns: int | None) -> None:
        """Beat from start_ns until `stop` is set or the duration has passed."""
        seq, missed = 0, 0
        events: tuple[Event, ...] = ()
        while not stop.is_set() and (duration_ns is None or seq * self._period_ns < duration_ns):
            beat_ns = start_ns + seq * self._period_ns
            self._clock.sleep_until(beat_ns)
            lateness_ns = self._clock.now_ns() - beat_ns
            events = self._beat(seq, beat_ns, lateness_ns, missed, events)
            elapsed = (self._clock.now_ns() - beat_ns) // self._period_ns
            missed = max(0, elapsed)
            if missed:
                events += (self._overrun(seq, beat_ns, missed, lateness_ns),)
            seq += 1 + missed

    def _beat(
        self, seq: int, beat_ns: int, lateness_ns: int, missed: int, carried: tuple[Event, ...]
    ) -> tuple[Event, ...]:
        """One tick; returns the events that belong into the next one."""
        began_ns = self._clock.now_ns()
        stages = self._stages
        stages.begin()
        events = carried + self._laser.drain_events() + self._encoders.drain_events() + self._commands()
        tick = Tick(seq, beat_ns, self._laser.latest(), self._encoders.drain(), events)
        stages.mark("read")
        estimate, defects = contained_step(self._estimator, tick)
        state_hash = self._estimator.state_hash()
        stages.mark("estimate")
        stepped_ns = self._clock.now_ns()
        before_ns = stages.durations_ns()
        step_ns = sum(before_ns.values()) - before_ns["read"]
        timing = Timing(lateness_ns, missed, {"step": step_ns, **before_ns, **self._after_ns})
        truth = self._truth(estimate.stamp_ns)
        stages.mark("truth")
        for name, sink in self._sinks.items():
            defects += contained_put(name, sink, tick, estimate, timing, state_hash, truth)
            stages.mark(f"hand to {name}")
        health, changes = self._monitor.assess(
            beat_ns,
            {"laser": self._laser.health(), "encoders": self._encoders.health()},
            {name: sink.health() for name, sink in self._sinks.items()},
            estimate.quality,
            estimate.doubt,
        )
        stages.mark("health")
        self._watch(tick, estimate, timing, health)
        stages.mark("status")
        ended_ns = self._clock.now_ns()
        durations_ns = stages.durations_ns()
        self._after_ns = {name: took for name, took in durations_ns.items() if name not in before_ns}
        self.timekeeping.note(beat_ns, lateness_ns, missed, ended_ns - began_ns)
        self.timekeeping.note_stages({"step": step_ns, **durations_ns}, ended_ns - stepped_ns)
        return defects + changes

    def _overrun(self, seq: int, beat_ns: int, missed: int, lateness_ns: int) -> Event:
        """Which stage of this tick kept the loop from the beats after it."""
        name, took_ns = slowest({ASLEEP: lateness_ns, **self._stages.durations_ns()})
        reason = f"{missed} beat(s) before tick {seq + 1 + missed} overslept: {name} took {took_ns * 1e-6:.0f} ms"
        return Event(beat_ns, "loop", "missed", reason, Severity.WARN)
