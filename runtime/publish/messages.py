"""What goes out over zenoh as bytes: the record's ROS messages in wall time, and JSON where a dashboard reads."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drivers.measurements import Event, Scan, SensorHealth, SensorState
from runtime.health import Health, RunState
from runtime.messages.definitions import construct, serialize
from runtime.messages.map_json import existence, json_bytes
from runtime.messages.ros import encode_odometry, encode_pose, encode_scan, header, ros_pose
from runtime.printable import printable
from runtime.sensor_report import sensor_object
from runtime.tick import CompletedTick, SinkHealth
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.pose import Pose2

SPHERE_LIST = 7  # visualization_msgs/Marker
TF = "tf2_msgs/msg/TFMessage"
MARKERS = "visualization_msgs/msg/MarkerArray"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
NO_BYTES = np.empty(0, np.uint8)
NO_TICK = dict.fromkeys(("seq", "quality", "lateness_ms", "step_ms", "pose", "sigma", "landmarks"))
RUN_LEVELS = {RunState.STARTING: 1, RunState.READY: 0, RunState.RUNNING: 0, RunState.STOPPING: 1}
RUN_LEVELS |= {RunState.DEGRADED: 1, RunState.LOST: 2}  # DiagnosticStatus OK, WARN, ERROR
LEVELS = {SensorState.FRESH: 0, SensorState.STARTING: 1, SensorState.STALE: 2, SensorState.FAILED: 2}


def pose_bytes(estimate: Estimate, wall_ns: int) -> bytes:
    """geometry_msgs/PoseWithCovarianceStamped in the frame map."""
    return encode_pose(replace(estimate, stamp_ns=wall_ns)).data


def odometry_bytes(estimate: Estimate, wall_ns: int) -> bytes:
    """nav_msgs/Odometry in the frame odom."""
    return encode_odometry(replace(estimate, stamp_ns=wall_ns)).data


def scan_bytes(scan: Scan, wall_ns: int, beam_step: int) -> bytes:
    """sensor_msgs/LaserScan of every beam_step-th beam, in the frame laser."""
    thinned = Scan(
        wall_ns,
        scan.ranges_m[::beam_step].copy(),
        scan.bearings_rad[::beam_step].copy(),
        scan.beam_period_s * beam_step,
        scan.stamp_beam // beam_step,
        scan.range_max_m,
    )
    return encode_scan(thinned).data


def transform_bytes(estimate: Estimate, wall_ns: int) -> bytes:
    """tf2_msgs/TFMessage: map to odom carries the correction, odom to base_link the dead reckoning (REP 105)."""
    map_from_odom = estimate.map_from_body @ estimate.odom_from_body.inverse()
    transforms = [
        _transform(wall_ns, "map", "odom", map_from_odom),
        _transform(wall_ns, "odom", "base_link", estimate.odom_from_body),
    ]
    return serialize(TF, construct(TF, transforms=transforms))


def landmark_bytes(landmarks: LandmarkMap, wall_ns: int) -> bytes:
    """visualization_msgs/MarkerArray: one list of spheres, red where existence is doubted, green where it is sure."""
    sure = existence(landmarks.existence_log_odds)
    marker = construct(
        "visualization_msgs/msg/Marker",
        header=header(wall_ns, "map"),
        ns="landmarks",
        id=0,
        type=SPHERE_LIST,
        action=0,
        pose=ros_pose(Pose2()),
        scale=_vector(0.3, 0.3, 0.3),
        color=_color(0.0, 1.0, 0.0),
        lifetime=construct("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[construct("geometry_msgs/msg/Point", x=x, y=y, z=0.0) for x, y in landmarks.means_m.tolist()],
        colors=[_color(1.0 - p, p, 0.1) for p in sure.tolist()],
        texture_resource="",
        texture=construct("sensor_msgs/msg/CompressedImage", header=header(0, ""), format="", data=NO_BYTES),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=construct("visualization_msgs/msg/MeshFile", filename="", data=NO_BYTES),
        mesh_use_embedded_materials=False,
    )
    return serialize(MARKERS, construct(MARKERS, markers=[marker]))


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
        "sensors": {} if health is None else _sensors(health.sensors),
        "sinks": {} if health is None else _sinks(health.sinks),
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
    nowhere, zero = Pose2(), np.zeros((3, 3))
    estimate = Estimate(0, nowhere, zero, nowhere, zero, nowhere, Quality.UNCERTAIN)
    landmarks = LandmarkMap(np.zeros(1, np.int64), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros(1))
    sensor = SensorHealth(SensorState.STARTING, "", 0.0, {"count": 0})
    pose_bytes(estimate, 0)
    odometry_bytes(estimate, 0)
    transform_bytes(estimate, 0)
    landmark_bytes(landmarks, 0)
    scan_bytes(Scan(0, np.zeros(2, np.float32), np.zeros(2)), 0, 1)
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
    }


def _sensors(sensors: Mapping[str, SensorHealth]) -> dict[str, Any]:
    return {name: sensor_object(sensor) for name, sensor in sensors.items()}


def _sinks(sinks: Mapping[str, SinkHealth]) -> dict[str, Any]:
    return {
        name: {"depth": sink.depth, "dropped": sink.dropped, "trouble": printable(sink.trouble)}
        for name, sink in sinks.items()
    }


def _transform(wall_ns: int, parent: str, child: str, parent_from_child: Pose2) -> Any:
    pose = ros_pose(parent_from_child)
    return construct(
        "geometry_msgs/msg/TransformStamped",
        header=header(wall_ns, parent),
        child_frame_id=child,
        transform=construct(
            "geometry_msgs/msg/Transform",
            translation=_vector(pose.position.x, pose.position.y, 0.0),
            rotation=pose.orientation,
        ),
    )


def _vector(x: float, y: float, z: float) -> Any:
    return construct("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _color(red: float, green: float, blue: float) -> Any:
    return construct("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0)
