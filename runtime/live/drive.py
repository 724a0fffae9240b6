"""A live run from start to summary."""

import threading
from collections.abc import Callable
from typing import Any, TextIO

from drivers.measurements import SensorState
from runtime.health import Health, HealthMonitor
from runtime.live.clock import Clock
from runtime.live.loop import Loop
from runtime.live.parts import Parts, live_parts
from runtime.live.stage_clock import StageClock
from runtime.live.status_line import StatusLine, status_text
from runtime.live.summary import ErrorTrack, summarise
from runtime.record.folder import RunFolder
from runtime.service.realtime import enter_real_time, freeze_garbage, leave_real_time
from runtime.service.systemd import ServiceManager, WatchdogFeed
from runtime.settings.configuration import Configuration
from runtime.tick import Tick, Timing
from slam.estimate import Estimate
from slam.estimator import Estimator

SENSOR_POLL_S = 0.02
LEAD_NS = 100_000_000  # from the last preparation to the first beat

Wiring = Callable[[Configuration, RunFolder, Clock], Parts]


def drive(
    configuration: Configuration,
    folder: RunFolder,
    clock: Clock,
    stop: threading.Event,
    duration_s: float | None,
    stream: TextIO,
    manager: ServiceManager,
    wire: Wiring | None = None,
) -> dict[str, Any]:
    """Run until `stop` or the duration, write everything, and return the summary (also kept as summary.json).

    wire: what makes the parts, live_parts unless told otherwise.
    """
    Estimator.warm_up(configuration.slam)
    stages = StageClock(clock)
    estimator = Estimator(configuration.slam, configuration.seed, stages.mark)
    parts = (wire or live_parts)(configuration, folder, clock)
    status = StatusLine(stream)
    errors = ErrorTrack()
    beats_per_s = max(1, round(configuration.loop.rate_hz))
    feed = WatchdogFeed(manager, stream)

    def watch(tick: Tick, estimate: Estimate, timing: Timing, health: Health) -> None:
        feed.completed_tick(parts.threads.stuck())
        if tick.seq % beats_per_s == 0:
            manager.status(status_text(tick, estimate, timing, health, configuration.loop.rate_hz))
        parts.publisher.note_health(health)
        status.note(tick, estimate, timing, health)

    loop = Loop(
        clock,
        parts.laser,
        parts.encoders,
        estimator,
        {**parts.sinks, "errors": errors},
        HealthMonitor(),
        round(1e9 / configuration.loop.rate_hz),
        parts.truth,
        watch,
        lambda: parts.publisher.drain_events() + parts.threads.drain_events(),
        stages,
    )
    try:
        parts.start()
        await_sensors(parts, configuration.loop.ready_s, stop)
        status.start()
        freeze_garbage()
        for refusal in enter_real_time(configuration.loop.priority):
            stream.write(f"infant: {refusal}\n")
        start_ns = clock.now_ns() + LEAD_NS
        parts.drive(start_ns)
        manager.ready()
        loop.run(start_ns, stop, None if duration_s is None else round(duration_s * 1e9))
        sensors = {"laser": parts.laser.health(), "encoders": parts.encoders.health()}
    finally:
        manager.stopping()
        leave_real_time()
        status.close()
        parts.close()
        manager.close()
    summary = summarise(str(folder.path), loop.timekeeping, errors, sensors)
    folder.write_summary(summary)
    return summary


def await_sensors(parts: Parts, ready_s: float, stop: threading.Event) -> None:
    """Wait until both sensors deliver, at most ready_s: a silent one is a state, not a reason not to start."""
    for _ in range(round(ready_s / SENSOR_POLL_S)):
        states = (parts.laser.health().state, parts.encoders.health().state)
        if states == (SensorState.FRESH, SensorState.FRESH) or stop.wait(SENSOR_POLL_S):
            return
