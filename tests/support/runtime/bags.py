"""Small recordings of ROS, as every recorder writes them."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.support.runtime.carmen_logs import moments, room_ranges

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
SCAN, ODOMETRY, TRANSFORMS = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS))
START_NS = 1_700_000_000_000_000_000
BEAMS = 181
Message = tuple[str, str, int, Any]
"""Topic, type, stamp ns, content."""


class Made:
    """Messages of one of the stores; the two differ in the header only."""

    def __init__(self, is_ros1: bool) -> None:
        self.store = ROS1 if is_ros1 else ROS2
        self.is_ros1 = is_ros1

    def build(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, stamp_ns: int, frame: str) -> Any:
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        stamp = self.build("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        extra = {"seq": 0} if self.is_ros1 else {}
        return self.build("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def scan(self, stamp_ns: int, ranges: list[float], first: float, step: float, **changes: Any) -> Any:
        fields: dict[str, Any] = {
            "header": self.header(stamp_ns, "laser"),
            "angle_min": first,
            "angle_max": first + step * (len(ranges) - 1),
            "angle_increment": step,
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.05,
            "range_max": 30.0,
            "ranges": np.array(ranges, np.float32),
            "intensities": np.empty(0, np.float32),
        }
        return self.build(SCAN, **(fields | changes))

    def turn(self, yaw: float, roll: float = 0.0) -> Any:
        cosine, sine = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        level, over = math.cos(0.5 * roll), math.sin(0.5 * roll)
        turned = (cosine * over, sine * over, sine * level, cosine * level)
        return self.build("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turned, strict=True)))

    def vector(self, name: str, x: float, y: float, z: float = 0.0) -> Any:
        return self.build(f"geometry_msgs/msg/{name}", x=x, y=y, z=z)

    def odometry(self, stamp_ns: int, x: float, y: float, heading: float) -> Any:
        pose = self.build("geometry_msgs/msg/Pose", position=self.vector("Point", x, y), orientation=self.turn(heading))
        still = self.vector("Vector3", 0.0, 0.0)
        twist = self.build("geometry_msgs/msg/Twist", linear=still, angular=still)
        unknown = np.zeros(36)
        return self.build(
            ODOMETRY,
            header=self.header(stamp_ns, "odom"),
            child_frame_id="base_link",
            pose=self.build("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self.build("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
        )

    def transforms(self, stamp_ns: int, *pairs: tuple[str, str, tuple[float, float, float], Any]) -> Any:
        made = [
            self.build(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(stamp_ns, parent),
                child_frame_id=child,
                transform=self.build(
                    "geometry_msgs/msg/Transform", translation=self.vector("Vector3", *offset), rotation=turn
                ),
            )
            for parent, child, offset, turn in pairs
        ]
        return self.build(TRANSFORMS, transforms=made)


def room_drive(made: Made, count: int = 30) -> Iterator[Message]:
    """A circle in a room, ten scans and ten poses a second, the laser 0.2 m ahead of a base that has a footprint."""
    pairs = (("base_link", "mast", (0.1, 0.0, 0.3), made.turn(0.0)), ("mast", "laser", (0.1, 0.0, 0.0), made.turn(0.0)))
    yield "/tf_static", TRANSFORMS, START_NS, made.transforms(START_NS, *pairs)
    for moment in moments(count):
        stamp_ns = START_NS + round(moment[0] * 1e9)
        yield "/odom", ODOMETRY, stamp_ns, made.odometry(stamp_ns, *moment[1:])
        ranges = room_ranges(moment, BEAMS)
        yield "/scan", SCAN, stamp_ns, made.scan(stamp_ns, ranges, -0.5 * math.pi, math.pi / (BEAMS - 1))


def write_bag1(
    path: Path,
    messages: Iterator[Message],
    packed: Writer1.CompressionFormat | None = None,
    chunk_bytes: int = 1 << 20,
) -> Path:
    """One .bag file."""
    writer = Writer1(path)
    writer.chunk_threshold = chunk_bytes
    if packed is not None:
        writer.set_compression(packed)
    with writer:
        known: dict[str, Any] = {}
        for topic, kind, stamp_ns, content in messages:
            connection = known.get(topic) or writer.add_connection(topic, kind, typestore=ROS1)
            known[topic] = connection
            writer.write(connection, stamp_ns, ROS1.serialize_ros1(content, kind))
    return path


def write_bag2(path: Path, messages: Iterator[Message], storage: str) -> Path:
    """A folder with metadata.yaml."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        known: dict[str, Any] = {}
        for topic, kind, stamp_ns, content in messages:
            connection = known.get(topic) or writer.add_connection(topic, kind, typestore=ROS2)
            known[topic] = connection
            writer.write(connection, stamp_ns, ROS2.serialize_cdr(content, kind))
    return path


def write_mcap(path: Path, messages: Iterator[Message], is_ros1: bool = False, chunk_bytes: int = 1 << 20) -> Path:
    """One .mcap file, of either ROS."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=chunk_bytes)
        writer.start()
        known: dict[str, int] = {}
        for topic, kind, stamp_ns, content in messages:
            if topic not in known:
                name = kind.replace("/msg/", "/") if is_ros1 else kind
                schema = writer.register_schema(name, "ros1msg" if is_ros1 else "ros2msg", b"")
                known[topic] = writer.register_channel(topic, "ros1" if is_ros1 else "cdr", schema)
            data = ROS1.serialize_ros1(content, kind) if is_ros1 else ROS2.serialize_cdr(content, kind)
            writer.add_message(known[topic], stamp_ns, bytes(data), stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
