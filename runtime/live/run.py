"""A live run from start to summary."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TextIO

from drivers.measurements import Event, SensorState
from runtime.health import Health, HealthMonitor, RunState
from runtime.live.clock import Clock
from runtime.live.deadline import NEVER_NS, Deadline
from runtime.live.kernels import load_kernels
from runtime.live.loop import Inputs, Loop, Outputs
from runtime.live.parts import Parts, live_parts
from runtime.live.stage_clock import StageClock
from runtime.live.status_line import StatusLine, state_text, status_text
from runtime.live.summary import ErrorTrack, summarise
from runtime.map_files.end import end_in_map
from runtime.map_files.start import RunStart, for_estimator
from runtime.record.folder import RunFolder
from runtime.service.realtime import enter_real_time, freeze_garbage, leave_real_time
from runtime.service.systemd import ServiceManager, WatchdogFeed
from runtime.settings.configuration import Configuration
from runtime.tick import CompletedTick
from slam.estimator import Estimator

READY_S = 5.0  # wait at most this long for both sensors before the first tick
SENSOR_POLL_S = 0.02
LEAD_NS = 100_000_000  # from the last preparation to the first beat


MakeParts = Callable[[Configuration, RunFolder, Clock], Parts]


@dataclass(frozen=True, slots=True)
class Host:
    """What a run gets from whoever starts it: time, the wish to stop, a stream for people and whether that may have
    colours, the service manager. deadline: when all has to be over, on this clock.
    """

    clock: Clock
    stop: threading.Event
    stream: TextIO
    manager: ServiceManager
    has_colours: bool = False
    deadline: Deadline = field(default_factory=Deadline)


def run_live(
    configuration: Configuration,
    folder: RunFolder,
    host: Host,
    duration_s: float | None = None,
    make_parts: MakeParts | None = None,
    start: RunStart | None = None,
) -> dict[str, Any]:
    """Run until `host.stop`, the duration or the deadline, write everything, and return the summary (also kept as
    summary.json).

    duration_s: from the first tick on. start: the saved map that the run begins in; what it adds goes into a new one
    at the end. Raises TimeIsOver where the deadline leaves no time for a first tick.
    """
    deadline = host.deadline
    with deadline.interrupts(host.clock.now_ns()):
        parts = (make_parts or partial(live_parts, start=start))(configuration, folder, host.clock)
    stages, errors = StageClock(host.clock), ErrorTrack()
    watch = Watch(host, parts, configuration.loop.rate_hz)
    try:
        events = watch.enter(RunState.STARTING)
        with deadline.interrupts(host.clock.now_ns()):
            load_kernels(configuration.slam, watch.line.announce, host.stop)
        estimator = Estimator(configuration.slam, configuration.seed, stages.mark, start=for_estimator(start))
        loop = Loop(
            stages,
            estimator,
            Inputs(parts.laser, parts.encoders, parts.drain_events, parts.truth),
            Outputs({**parts.sinks, "errors": errors}, watch.monitor, watch),
            round(1e9 / configuration.loop.rate_hz),
        )
        if not host.stop.is_set():
            with deadline.interrupts(host.clock.now_ns()):
                parts.start()
                await_sensors(parts, READY_S, host.stop)
            watch.line.start()
            freeze_garbage()
            for refusal in enter_real_time(configuration.loop.priority):
                watch.line.write(f"infant: {refusal}\n")
            events += watch.enter(RunState.READY)
            start_ns = host.clock.now_ns() + LEAD_NS
            parts.start_world(start_ns)
            events += () if start is None else (start.event(start_ns),)
            host.manager.ready()
            driven_ns = NEVER_NS if duration_s is None else round(duration_s * 1e9)
            loop.run(start_ns, host.stop, min(driven_ns, deadline.drive_until_ns - start_ns), events)
        summary = summarise(str(folder.path), loop.timekeeping, errors, parts.sensor_health())
    finally:
        host.manager.stopping()
        parts.recorder.put_events(host.clock.now_ns(), watch.enter(RunState.STOPPING))
        leave_real_time()
        watch.line.close()
        parts.close(deadline.closed_by_ns)
        host.manager.close()
    if parts.drawing is not None and (trouble := parts.drawing.health().trouble):
        watch.line.write(f"infant: {trouble}\n")
    if start is not None:
        summary["map"] = end_in_map(estimator.joint_map(), start, configuration, folder)
    folder.write_summary(summary)
    return summary


class Watch:
    """Tells everyone how the run is: the service manager, a person at the terminal, and tools over zenoh."""

    def __init__(self, host: Host, parts: Parts, rate_hz: float) -> None:
        self.monitor = HealthMonitor()
        self.line = StatusLine(host.stream, host.has_colours)
        self._host = host
        self._parts = parts
        self._rate_hz = rate_hz
        self._feed = WatchdogFeed(host.manager, host.stream)

    def enter(self, state: RunState) -> tuple[Event, ...]:
        """A state before the first tick or after the last one; returns its event, for the record."""
        parts = self._parts
        sinks = {name: sink.health() for name, sink in parts.sinks.items()}
        health, events = self.monitor.enter(self._host.clock.now_ns(), state, parts.sensor_health(), sinks)
        parts.publisher.announce(health)
        self._host.manager.status(state_text(health))
        return events

    def __call__(self, completed: CompletedTick, health: Health) -> None:
        """After each tick; the watchdog is fed only here."""
        self._feed.completed_tick(self._parts.threads.stuck())
        if completed.tick.seq % max(1, round(self._rate_hz)) == 0:
            self._host.manager.status(status_text(completed, health, self._rate_hz))
        self._parts.publisher.note_health(health)
        self.line.note(completed, health)


def await_sensors(parts: Parts, ready_s: float, stop: threading.Event) -> None:
    """Wait until both sensors deliver, at most ready_s: a silent one is a state, not a reason not to start."""
    for _ in range(round(ready_s / SENSOR_POLL_S)):
        states = {health.state for health in parts.sensor_health().values()}
        if states == {SensorState.FRESH} or stop.wait(SENSOR_POLL_S):
            return
