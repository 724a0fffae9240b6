"""infant bridge ros2: a process of its own from a rover's zenoh keys to DDS, which stock ROS 2 speaks."""

import re
import threading
from dataclasses import dataclass
from typing import Any, TextIO

from runtime.bridge.bridge import Bridge, run_bridge
from runtime.bridge.dds import LOOPBACK, DdsParticipant
from runtime.bridge.initial_pose import INITIAL_POSE
from runtime.bridge.topics import HEARD, TOPICS, in_namespace
from runtime.errors import UsageError
from runtime.printable import printable, tell
from runtime.publish.find_rover import find_rover
from runtime.publish.follow import following
from runtime.publish.ros2_keys import ros_name
from runtime.ros2.vehicle import Frames

MOST_DOMAIN = 232
LONGEST_NAME = 100  # characters; DDS takes 255 for a whole topic


@dataclass(frozen=True, slots=True)
class BridgeOptions:
    """What the command was asked for; None: the rover's own name. resolution_m: of the grid, None: no grid."""

    connect: str | None = None
    rover: str | None = None
    config_file: str | None = None
    domain: int = 0
    interface: str = LOOPBACK
    namespace: str | None = None
    frame_prefix: str | None = None
    resolution_m: float | None = 0.1


def bridge_ros2(options: BridgeOptions, stop: threading.Event, said: TextIO) -> dict[str, Any]:
    """Run until `stop`; returns what was sent. said: gets where it is, and each kind of trouble once.

    Raises UsageError, SensorError, ConfigurationError.
    """
    if not 0 <= options.domain <= MOST_DOMAIN:
        raise UsageError(f"--domain {options.domain}: expected 0 to {MOST_DOMAIN}, the ROS_DOMAIN_ID of the nodes")
    for option, name in (("--namespace", options.namespace), ("--frame-prefix", options.frame_prefix)):
        _refuse_no_name(option, name)
    rover = find_rover(options.connect, options.rover, options.config_file)
    own = ros_name(rover.name)
    namespace = own if options.namespace is None else options.namespace.strip("/")
    frames = Frames(own if options.frame_prefix is None else options.frame_prefix.strip("/"))
    participant = DdsParticipant(options.domain, options.interface)
    topics = [in_namespace(topic, namespace) for topic in TOPICS]
    bridge = Bridge({topic.key: (topic, participant.writer(topic)) for topic in topics}, frames)
    tell(
        said,
        f"infant: {rover.name} at {rover.endpoint} is in ROS 2 domain {options.domain} on {options.interface}: "
        f"{', '.join(topic.name for topic in topics)}\n",
    )
    with following(rover, HEARD, options.config_file) as follower:
        poses = participant.reader(in_namespace(INITIAL_POSE, namespace))
        run_bridge(follower, bridge, poses.take, options.resolution_m, stop, said)
    return {"rover": rover.name, "sent": dict(sorted(bridge.sent.items()))}


def _refuse_no_name(option: str, name: str | None) -> None:
    """Raises UsageError where ROS 2 could not have the name."""
    words = (name or "").strip("/")
    if words and (len(words) > LONGEST_NAME or not re.fullmatch(r"([A-Za-z_]\w*/)*[A-Za-z_]\w*", words, re.ASCII)):
        raise UsageError(
            f"{option} {printable(name or '')!r}: expected up to {LONGEST_NAME} letters, digits and _, parts of it "
            "between / and none that begins with a digit, as in fleet/rover1"
        )
