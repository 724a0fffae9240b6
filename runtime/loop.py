"""The loop: read, step, hand on, sleep until the next point of a fixed grid."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers.measurements import Encoders, Event, Laser, Severity
from runtime.clock import Clock
from runtime.containment import Stepping, contained_step
from runtime.health import Health, HealthMonitor
from runtime.tick import Sink, Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

Truth = Callable[[int], Pose2 | None]
Watch = Callable[[Tick, Estimate, Timing, Health], None]


@dataclass(slots=True)
class Timekeeping:
    """How well the grid was kept: one entry a tick, in nanoseconds."""

    lateness_ns: list[int] = field(default_factory=list)
    duration_ns: list[int] = field(default_factory=list)
    missed: int = 0
    first_beat_ns: int = 0
    last_beat_ns: int = 0

    def note(self, beat_ns: int, lateness_ns: int, missed: int, duration_ns: int) -> None:
        """One tick that has ended."""
        if not self.lateness_ns:
            self.first_beat_ns = beat_ns
        self.last_beat_ns = beat_ns
        self.missed += missed
        self.lateness_ns.append(lateness_ns)
        self.duration_ns.append(duration_ns)

    @property
    def rate_hz(self) -> float:
        """Ticks a second between the first and the last."""
        span_ns = self.last_beat_ns - self.first_beat_ns
        return (len(self.lateness_ns) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0


class Loop:
    """Runs the estimator on a fixed grid of beats; a beat that is overslept is skipped, counted and recorded.

    Nothing in here waits for a sensor, a file or a network: the sensors hand out what they have, the sinks queue.
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
            seq += 1 + missed

    def _beat(
        self, seq: int, beat_ns: int, lateness_ns: int, missed: int, carried: tuple[Event, ...]
    ) -> tuple[Event, ...]:
        """One tick; returns the events that belong into the next one."""
        began_ns = self._clock.now_ns()
        events = carried + self._laser.drain_events() + self._encoders.drain_events() + self._commands()
        if missed:
            events += (
                Event(beat_ns, "loop", "missed", f"{missed} beat(s) before tick {seq} overslept", Severity.WARN),
            )
        tick = Tick(seq, beat_ns, self._laser.latest(), self._encoders.drain(), events)
        read_ns = self._clock.now_ns()
        estimate, defects = contained_step(self._estimator, tick)
        stepped_ns = self._clock.now_ns()
        timing = Timing(lateness_ns, missed, {"read": read_ns - began_ns, "step": stepped_ns - read_ns})
        state_hash = self._estimator.state_hash()
        truth = self._truth(estimate.stamp_ns)
        for sink in self._sinks.values():
            sink.put(tick, estimate, timing, state_hash, truth)
        health, changes = self._monitor.assess(
            beat_ns,
            {"laser": self._laser.health(), "encoders": self._encoders.health()},
            {name: sink.health() for name, sink in self._sinks.items()},
            estimate.quality,
        )
        self._watch(tick, estimate, timing, health)
        self.timekeeping.note(beat_ns, lateness_ns, missed, self._clock.now_ns() - began_ns)
        return defects + changes

