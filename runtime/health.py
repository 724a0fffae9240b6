"""How the runtime is: one state with its reasons, from the sensors, the sinks and the pose's own quality."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from drivers.measurements import Event, SensorHealth, SensorState, Severity
from runtime.printable import printable
from runtime.tick import SinkHealth
from slam.estimate import Estimate, Quality, Recognition


class RunState(StrEnum):
    """The states a run goes through."""

    STARTING = "starting"
    """Kernels load and the sensors connect; there is no pose yet."""
    READY = "ready"
    """Everything has been started and waited for; the first tick follows."""
    RUNNING = "running"
    DEGRADED = "degraded"
    LOST = "lost"
    STOPPING = "stopping"
    """The last tick has ended; sensors are closed, what is queued is written and sent."""


@dataclass(frozen=True, slots=True)
class PlaceInMap:
    """The map that the pose is in, since when, and the last recognition of a place (None: none yet)."""

    map_id: int
    since_ns: int
    recognised_ns: int | None = None
    recognition: Recognition | None = None


@dataclass(frozen=True, slots=True)
class Health:
    """State with reasons, and what it was concluded from; quality is None before the first tick, place before the
    first scan.
    """

    stamp_ns: int
    state: RunState
    reasons: tuple[str, ...]
    sensors: Mapping[str, SensorHealth]
    sinks: Mapping[str, SinkHealth]
    quality: Quality | None
    place: PlaceInMap | None = None


SETTLED_NS = 2_000_000_000
"""An improvement is an event once it has lasted so long: what flickers at its threshold is told once."""
GRAVITY = {RunState.LOST: 2, RunState.DEGRADED: 1}
SEVERITIES = {RunState.DEGRADED: Severity.WARN, RunState.LOST: Severity.ERROR}


class HealthMonitor:
    """Concludes the state once a tick, and is told the states before the first and after the last one.

    What is new or worse is an event at once, with its reason; what is better, once it has settled.
    """

    def __init__(self) -> None:
        self._told: tuple[RunState | None, frozenset[str]] = (None, frozenset())
        self._recent: dict[str, tuple[int, int]] = {}
        self._quality: Quality | None = None
        self._dropped: dict[str, int] = {}
        self._place: PlaceInMap | None = None

    def enter(
        self,
        stamp_ns: int,
        state: RunState,
        sensors: Mapping[str, SensorHealth],
        sinks: Mapping[str, SinkHealth],
    ) -> tuple[Health, tuple[Event, ...]]:
        """STARTING, READY or STOPPING, which follow from nothing that a tick knows; and what is not well meanwhile."""
        reasons = (*_sensor_reasons(sensors), *self._sink_reasons(sinks))
        health = Health(stamp_ns, state, reasons, sensors, sinks, self._quality, self._place)
        return health, self._changed(stamp_ns, state, reasons)

    def assess(
        self,
        stamp_ns: int,
        sensors: Mapping[str, SensorHealth],
        sinks: Mapping[str, SinkHealth],
        estimate: Estimate,
    ) -> tuple[Health, tuple[Event, ...]]:
        """Health now, and an event where the state or a reason has changed, or a place was recognised."""
        self._quality = quality = estimate.quality
        reasons = (*_sensor_reasons(sensors), *self._sink_reasons(sinks))
        if quality is not Quality.TRACKING:
            reasons = (f"pose {quality}, {estimate.doubt}" if estimate.doubt else f"pose {quality}", *reasons)
        if quality is Quality.LOST:
            state = RunState.LOST
        elif reasons:
            state = RunState.DEGRADED
        else:
            state = RunState.RUNNING
        placed = (*_recognised(stamp_ns, estimate.recognition), *_refused(stamp_ns, estimate.refusal))
        events = (*placed, *self._changed(stamp_ns, state, reasons))
        self._follow_place(stamp_ns, estimate)
        return Health(stamp_ns, state, reasons, sensors, sinks, quality, self._place), events

    def _follow_place(self, stamp_ns: int, estimate: Estimate) -> None:
        map_id = int(estimate.counts.get("map_id", 0))
        if map_id and (self._place is None or map_id != self._place.map_id):
            last = self._place or PlaceInMap(map_id, stamp_ns)
            self._place = replace(last, map_id=map_id, since_ns=stamp_ns)
        found = estimate.recognition
        if self._place is not None and found is not None and not found.is_new:
            self._place = replace(self._place, recognised_ns=stamp_ns, recognition=found)

    def _sink_reasons(self, sinks: Mapping[str, SinkHealth]) -> list[str]:
        """Sinks in trouble, and sinks that have dropped something since the last call."""
        reasons = []
        for name, sink in sinks.items():
            if sink.trouble:
                reasons.append(printable(f"{name}: {sink.trouble}"))
            elif sink.dropped > self._dropped.get(name, 0):
                reasons.append(f"{name} drops")
            self._dropped[name] = sink.dropped
        return reasons

    def _changed(self, stamp_ns: int, state: RunState, reasons: tuple[str, ...]) -> tuple[Event, ...]:
        # the first words of a reason name it; figures that follow would make every tick an event
        names = {reason.split(":")[0] for reason in reasons}
        if state not in (RunState.RUNNING, *GRAVITY):
            self._recent.clear()
        self._recent |= {name: (stamp_ns, GRAVITY.get(state, 0)) for name in names}
        self._recent = {name: (at, of) for name, (at, of) in self._recent.items() if stamp_ns - at < SETTLED_NS}
        improving = any(gravity > GRAVITY.get(state, 0) for _, gravity in self._recent.values())
        told_state, told = self._told
        if improving or (state is told_state and names <= told <= self._recent.keys()):
            return ()
        self._told = state, frozenset(self._recent)
        text = f"{state}: {'; '.join(reasons)}" if reasons else str(state)
        return (Event(stamp_ns, "health", str(state), text, SEVERITIES.get(state, Severity.INFO)),)


def _sensor_reasons(sensors: Mapping[str, SensorHealth]) -> list[str]:
    """Sensors that do not deliver as they should."""
    return [
        printable(f"{name} {health.state}: {health.reason}")  # a device may say anything
        for name, health in sensors.items()
        if health.state is not SensorState.FRESH
    ]


def _recognised(stamp_ns: int, found: Recognition | None) -> tuple[Event, ...]:
    """The event of a place that was recognised, or of a new map."""
    if found is None:
        return ()
    if found.is_new:
        text = f"lost in unknown surroundings: map {found.map_id} begins here; the earlier ones are kept and searched"
        return (Event(stamp_ns, "pose", "new map", text, Severity.WARN),)
    joined = f", which map {found.joined} has become part of" if found.joined else ""
    walls = "walls and " if found.by_scans else ""
    text = (
        f"recognised in map {found.map_id}{joined}: by {walls}{found.matches} landmarks, odds {found.odds:.0f} "
        f"(mirror image {found.mirror_odds:.0f}), wrong with a probability of "
        f"{found.probability_wrong:.1g}; the pose moved {found.moved_m:.1f} m and "
        f"{math.degrees(found.turned_rad):.0f} deg"
    )
    return (Event(stamp_ns, "pose", "recognised", text),)


def _refused(stamp_ns: int, refusal: str) -> tuple[Event, ...]:
    """The event of a pose that somebody gave and nothing agrees with."""
    return (Event(stamp_ns, "pose", "refused", refusal, Severity.WARN),) if refusal else ()
