"""Which of a rover's keys become which topics of ROS 2, and what each topic offers."""

from dataclasses import dataclass, replace

from runtime.maps.grid_message import GRID
from runtime.publish.messages import DIAGNOSTICS
from runtime.ros2.laser_scan import SCAN
from runtime.ros2.markers import MARKERS
from runtime.ros2.odometry import ODOMETRY
from runtime.ros2.poses import PATH, POSE, POSES
from runtime.ros2.transforms import TF

SHARED = ("/tf", "/tf_static", "/diagnostics")  # one topic for all nodes of a system


@dataclass(frozen=True, slots=True)
class BridgedTopic:
    """A topic of ROS 2.

    key: the last word of the rover's key. reliable, latched (transient local) and depth are its QoS.
    """

    key: str
    name: str
    type_name: str
    reliable: bool = True
    latched: bool = False
    depth: int = 10


TOPICS = (
    BridgedTopic("scan_full", "/scan", SCAN, reliable=False, depth=5),
    BridgedTopic("pose", "/pose", POSE),
    BridgedTopic("odom", "/odom", ODOMETRY),
    BridgedTopic("tf", "/tf", TF, depth=100),
    BridgedTopic("tf_static", "/tf_static", TF, latched=True, depth=1),
    BridgedTopic("grid", "/map", GRID, latched=True, depth=1),
    BridgedTopic("landmarks", "/landmarks", MARKERS),
    BridgedTopic("particles", "/particles", POSES),
    BridgedTopic("path", "/path", PATH),
    BridgedTopic("health", "/diagnostics", DIAGNOSTICS),
)
"""tf_static is asked for, grid is made here of poses and scans; all others the rover publishes."""

ASKED, MADE = "tf_static", "grid"
HEARD = tuple(topic.key for topic in TOPICS if topic.key not in (ASKED, MADE))


def in_namespace(topic: BridgedTopic, namespace: str) -> BridgedTopic:
    """/scan of rover1 is /rover1/scan; shared topics stay as they are."""
    if topic.name in SHARED or not namespace:
        return topic
    return replace(topic, name=f"/{namespace}{topic.name}")
