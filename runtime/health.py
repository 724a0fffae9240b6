"""How the runtime is: one state with its reasons, from the sensors, the sinks and the pose's own quality."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from drivers.measurements import Event, SensorHealth, SensorState, Severity
from runtime.tick import SinkHealth
from slam.estimate import Quality


class RunState(StrEnum):
    """The states a run goes through."""

    STARTING = "starting"
    READY = "ready"
    RUNNING = "running"
    DEGRADED = "degraded"
    LOST = "lost"
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Health:
    """State with reasons, and what it was concluded from."""

    stamp_ns: int
    state: RunState
    reasons: tuple[str, ...]
    sensors: Mapping[str, SensorHealth]
    sinks: Mapping[str, SinkHealth]
    quality: Quality


SEVERITIES = {RunState.DEGRADED: Severity.WARN, RunState.LOST: Severity.ERROR}


class HealthMonitor:
    """Concludes the state once a tick; each change is an event with its reason."""

    def __init__(self) -> None:
        self._state = RunState.STARTING
        self._reasons: tuple[str, ...] = ()
        self._dropped: dict[str, int] = {}

    def assess(
        self,
        stamp_ns: int,
        sensors: Mapping[str, SensorHealth],
        sinks: Mapping[str, SinkHealth],
        quality: Quality,
        doubt: str = "",
    ) -> tuple[Health, tuple[Event, ...]]:
        """Health now, and an event if the state or a reason has changed since the last call.

        doubt: why the pose is not believed, as the estimate says.
        """
        reasons = tuple(
            f"{name} {health.state}: {health.reason}"
            for name, health in sensors.items()
            if health.state is not SensorState.FRESH
        )
        reasons += tuple(self._sink_reasons(sinks))
        if quality is not Quality.TRACKING:
            reasons = (f"pose {quality}, {doubt}" if doubt else f"pose {quality}", *reasons)
        if quality is Quality.LOST:
            state = RunState.LOST
        elif reasons:
            state = RunState.DEGRADED
        else:
            state = RunState.RUNNING
        return Health(stamp_ns, state, reasons, sensors, sinks, quality), self._changed(stamp_ns, state, reasons)

    def _sink_reasons(self, sinks: Mapping[str, SinkHealth]) -> list[str]:
        """Sinks in trouble, and sinks that have dropped something since the last call."""
        reasons = []
        for name, sink in sinks.items():
            if sink.trouble:
                reasons.append(f"{name}: {sink.trouble}")
            elif sink.dropped > self._dropped.get(name, 0):
                reasons.append(f"{name} drops")
            self._dropped[name] = sink.dropped
        return reasons

    def _changed(self, stamp_ns: int, state: RunState, reasons: tuple[str, ...]) -> tuple[Event, ...]:
        # the first words of a reason name it; figures that follow would make every tick an event
        before = {reason.split(":")[0] for reason in self._reasons}
        after = {reason.split(":")[0] for reason in reasons}
        if state is self._state and before == after:
            return ()
        self._state, self._reasons = state, reasons
        text = f"{state}: {'; '.join(reasons)}" if reasons else str(state)
        return (Event(stamp_ns, "health", str(state), text, SEVERITIES.get(state, Severity.INFO)),)
