"""What goes out over zenoh as bytes: the record's ROS messages in wall time, and JSON where a dashboard reads."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from drivers.measurements import Event, Scan, SensorHealth, SensorState
from runtime.health import Health, PlaceInMap, RunState
from runtime.messages.definitions import construct, serialize
from runtime.messages.map_json import json_bytes
from runtime.messages.ros import header
from runtime.printable import printable
from runtime.ros2.laser_scan import scan_bytes
from runtime.ros2.markers import landmark_bytes
from runtime.ros2.odometry import OdometryTrack, odometry_bytes
from runtime.ros2.poses import DrivenPath, particle_bytes, pose_bytes
from runtime.ros2.transforms import static_bytes, transform_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.sensor_report import sensor_object
from runtime.tick import CompletedTick, SinkHealth
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.pose import Pose2

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
NO_TICK = dict.fromkeys(("seq", "quality", "lateness_ms", "step_ms", "pose", "sigma", "landmarks", "filter"))
FILTER = ("features", "matched", "effective_particles")
"""What of the estimate's figures a status tells."""
RUN_LEVELS = {RunState.STARTING: 1, RunState.READY: 0, RunState.RUNNING: 0, RunState.STOPPING: 1}
RUN_LEVELS |= {RunState.DEGRADED: 1, RunState.LOST: 2}  # DiagnosticStatus OK, WARN, ERROR
LEVELS = {SensorState.FRESH: 0, SensorState.STARTING: 1, SensorState.STALE: 2, SensorState.FAILED: 2}


def event_json(event: Event, wall_ns: int) -> bytes:
    """One event."""
    return json_bytes(
        {
            "stamp_ns": wall_ns,
            "source": event.source,
            "kind": event.kind,
            "severity": event.severity.value,
            "reason": event.reason,
        }
    )


def status_object(
    rover: str, wall_ns: int, completed: CompletedTick | None, rate_hz: float, health: Health | None
) -> dict[str, Any]:
    """How the rover is, for a person or a dashboard.

    Until the health of the run is known state is null; before the first tick so is all that a tick tells.
    """
    return {
        "rover": rover,
        "stamp_ns": wall_ns,
        "state": None if health is None else health.state.value,
        "reasons": [] if health is None else list(health.reasons),
        "rate_hz": round(rate_hz, 3),
        **(NO_TICK if completed is None else _tick_fields(completed)),
        "map": None if health is None or health.place is None else _place(health.place, health.stamp_ns),
        "sensors": {} if health is None else _sensors(health.sensors),
        "sinks": {} if health is None else _sinks(health.sinks),
    }


def _place(place: PlaceInMap, now_ns: int) -> dict[str, Any]:
    """Which map, for how long, and how the rover was last recognised in one; None where it was not."""
    shown: dict[str, Any] = {"id": place.map_id, "for_s": round((now_ns - place.since_ns) * 1e-9, 1)}
    found, then_ns = place.recognition, place.recognised_ns
    if found is None or then_ns is None:
        return shown | dict.fromkeys(("recognised_s_ago", "by_scans", "matches", "odds", "mirror_odds"))
    return shown | {
        "recognised_s_ago": round((now_ns - then_ns) * 1e-9, 1),
        "by_scans": found.by_scans,
        "matches": found.matches,
        "odds": round(found.odds, 1),
        "mirror_odds": round(found.mirror_odds, 1) if math.isfinite(found.mirror_odds) else None,
    }


def health_bytes(health: Health, wall_ns: int) -> bytes:
    """diagnostic_msgs/DiagnosticArray: the state of the run, then each sensor with all its counters and figures."""
    run = construct(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=RUN_LEVELS[health.state],
        name="run",
        message="; ".join((health.state.value, *health.reasons)),
        hardware_id="",
        values=[],
    )
    sensors = [
        construct(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=LEVELS[sensor.state],
            name=name,
            message=printable(f"{sensor.state.value}: {sensor.reason}" if sensor.reason else sensor.state.value),
            hardware_id=printable(sensor.facts.get("serial_number", "")),
            values=[
                construct("diagnostic_msgs/msg/KeyValue", key=key, value=printable(str(value)))
                for key, value in (*sensor.counters.items(), *sensor.figures.items(), *sensor.facts.items())
            ],
        )
        for name, sensor in health.sensors.items()
    ]
    return serialize(DIAGNOSTICS, construct(DIAGNOSTICS, header=header(wall_ns, ""), status=[run, *sensors]))


def warm_up() -> None:
    """Encode one of everything, so that no encoder is generated (50 ms) while the loop runs."""
    nowhere, zero, vehicle, path = Pose2(), np.zeros((3, 3)), Vehicle(), DrivenPath()
    estimate = Estimate(0, nowhere, zero, nowhere, zero, nowhere, Quality.UNCERTAIN)
    landmarks = LandmarkMap(np.zeros(1, np.int64), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1))
    sensor = SensorHealth(SensorState.STARTING, "", 0.0, {"count": 0})
    path.add(0, nowhere)
    pose_bytes(0, estimate)
    odometry_bytes(0, OdometryTrack(vehicle.odometry).take(estimate))
    transform_bytes(0, nowhere, nowhere)
    static_bytes(0, vehicle)
    particle_bytes(0, np.zeros((1, 3)))
    path.as_bytes(0)
    landmark_bytes(landmarks, 0)
    scan_bytes(Scan(0, np.zeros(2, np.float32), np.zeros(2)), 0, vehicle)
    health_bytes(Health(0, RunState.STARTING, (), {"laser": sensor}, {}, Quality.UNCERTAIN), 0)


def _tick_fields(completed: CompletedTick) -> dict[str, Any]:
    estimate, timing = completed.estimate, completed.timing
    pose, sigmas = estimate.map_from_body, np.sqrt(np.diag(estimate.covariance).clip(min=0.0))
    return {
        "seq": completed.tick.seq,
        "quality": estimate.quality.value,
        "lateness_ms": round(timing.lateness_ns * 1e-6, 3),
        "step_ms": round(timing.stages_ns.get("step", 0) * 1e-6, 3),
        "pose": {"x_m": pose.x_m, "y_m": pose.y_m, "heading_rad": pose.heading_rad},
        "sigma": {"x_m": float(sigmas[0]), "y_m": float(sigmas[1]), "heading_rad": float(sigmas[2])},
        "landmarks": int(estimate.counts.get("landmarks", 0)),
        "filter": {name: round(estimate.counts[name], 1) for name in FILTER if name in estimate.counts},
    }


def _sensors(sensors: Mapping[str, SensorHealth]) -> dict[str, Any]:
    return {name: sensor_object(sensor) for name, sensor in sensors.items()}


def _sinks(sinks: Mapping[str, SinkHealth]) -> dict[str, Any]:
    return {
        name: {"depth": sink.depth, "dropped": sink.dropped, "trouble": printable(sink.trouble)}
        for name, sink in sinks.items()
    }
