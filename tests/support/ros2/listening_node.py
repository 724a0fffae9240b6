"""A real rclpy node, for a Python of ROS: what arrives on the bridge's topics within some seconds, as one JSON object.

It imports nothing of ours: `python listening_node.py NAMESPACE SECONDS`.
"""

import itertools
import json
import sys
import time
from importlib import import_module
from typing import Any

import rclpy  # type: ignore[import-not-found]
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # type: ignore[import-not-found]

TOPICS = {  # type, reliable, latched: as nav2 and rviz subscribe
    "scan": ("sensor_msgs/LaserScan", False, False),
    "pose": ("geometry_msgs/PoseWithCovarianceStamped", True, False),
    "odom": ("nav_msgs/Odometry", True, False),
    "map": ("nav_msgs/OccupancyGrid", True, True),
    "landmarks": ("visualization_msgs/MarkerArray", True, False),
    "particles": ("geometry_msgs/PoseArray", True, False),
    "path": ("nav_msgs/Path", True, False),
    "/diagnostics": ("diagnostic_msgs/DiagnosticArray", True, False),
    "/tf": ("tf2_msgs/TFMessage", True, False),
    "/tf_static": ("tf2_msgs/TFMessage", True, True),
}


def stamp_of(message: object) -> float:
    stamp = message.header.stamp  # type: ignore[attr-defined]
    return float(stamp.sec + stamp.nanosec * 1e-9)


def stamp_ns_of(message: object) -> int:
    stamp = message.header.stamp  # type: ignore[attr-defined]
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def click(message: Any) -> Any:
    """As RViz sends it: 3 m, -2 m, straight ahead, known to 0.5 m and 0.25 rad."""
    message.header.frame_id = "map"
    message.pose.pose.position.x, message.pose.pose.position.y = 3.0, -2.0
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[0] = message.pose.covariance[7] = 0.25
    message.pose.covariance[35] = 0.0625
    return message


def main() -> None:
    namespace, seconds = sys.argv[1], float(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node("listening", namespace=namespace)
    found: dict[str, dict[str, object]] = {}
    ages_ms: list[float] = []
    stamps: list[float] = []
    stamps_ns: list[int] = []

    def hear(topic: str, message: object) -> None:
        entry = found.setdefault(topic, {"count": 0, "first_s": time.monotonic() - began_s})
        entry["count"] = int(entry["count"]) + 1  # type: ignore[call-overload]
        if hasattr(message, "header"):
            entry["frame"] = message.header.frame_id
        if topic == "pose":
            ages_ms.append((time.time() - stamp_of(message)) * 1e3)
            stamps_ns.append(stamp_ns_of(message))
            stamps.append(stamp_of(message))
        if topic == "odom":
            entry["child"] = message.child_frame_id  # type: ignore[attr-defined]
            entry["covariance"] = message.pose.covariance[0]  # type: ignore[attr-defined]
        if topic.startswith("/tf"):
            links = set(map(tuple, entry.get("links", [])))  # type: ignore[call-overload]
            for each in message.transforms:  # type: ignore[attr-defined]
                links.add((each.header.frame_id, each.child_frame_id))
            entry["links"] = sorted(links)

    began_s = time.monotonic()
    absent = []
    for topic, (kind, reliable, latched) in TOPICS.items():
        package, name = kind.split("/")
        try:
            message_type = getattr(import_module(package + ".msg"), name)
        except ImportError:
            absent.append(topic)
            continue
        qos = QoSProfile(depth=100)
        qos.reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        node.create_subscription(message_type, topic, lambda message, topic=topic: hear(topic, message), qos)
    pose_type = import_module("geometry_msgs.msg").PoseWithCovarianceStamped
    clicks, clicked_s = node.create_publisher(pose_type, "initialpose", 1), began_s
    while time.monotonic() - began_s < seconds:
        rclpy.spin_once(node, timeout_sec=0.2)
        if time.monotonic() - clicked_s > 1.0:
            clicks.publish(click(pose_type()))
            clicked_s = time.monotonic()
    known = dict(node.get_topic_names_and_types())
    gaps = [b - a for a, b in itertools.pairwise(stamps)]
    print(  # noqa: T201
        json.dumps(
            {
                "found": found,
                "absent": absent,
                "topics": known,
                "age_ms": sorted(ages_ms)[len(ages_ms) // 2] if ages_ms else None,
                "poses": list(zip(stamps_ns, ages_ms, strict=True)),
                "gaps_s": [min(gaps), max(gaps)] if gaps else None,
            }
        )
    )
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
