#!/usr/bin/env python3
"""A rover in ROS 2, as a node of a machine that has ROS: one file, which needs rclpy and the package eclipse-zenoh.

    infant bridge rclpy --out infant_bridge.py             # on any machine with infant: writes this file
    pip install eclipse-zenoh                              # into the Python of ROS: 3.10 or 3.12
    python3 infant_bridge.py --rover rover1 --connect tcp/192.168.1.20:7448

CDR goes through untouched; with --frame-prefix messages are read and written again with their frames renamed. The grid
comes from `infant map live`, where that runs. A pose on initialpose, as RViz sends it, becomes the rover's command
initial_pose; its answer is one line on standard error.
"""

import argparse
import json
import math
import queue
import re
import signal
import sys
import threading
import time
from contextlib import suppress
from importlib import import_module
from typing import Any

TOPICS = {  # last word of the key: topic, type, reliable, latched, depth
    "scan_full": ("scan", "sensor_msgs/msg/LaserScan", False, False, 5),
    "pose": ("pose", "geometry_msgs/msg/PoseWithCovarianceStamped", True, False, 10),
    "odom": ("odom", "nav_msgs/msg/Odometry", True, False, 10),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage", True, False, 100),
    "tf_static": ("/tf_static", "tf2_msgs/msg/TFMessage", True, True, 1),
    "grid": ("map", "nav_msgs/msg/OccupancyGrid", True, True, 1),
    "landmarks": ("landmarks", "visualization_msgs/msg/MarkerArray", True, False, 10),
    "particles": ("particles", "geometry_msgs/msg/PoseArray", True, False, 10),
    "path": ("path", "nav_msgs/msg/Path", True, False, 10),
    "health": ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", True, False, 10),
}
WAKE_S = 0.2
ASK_S = 2.0
INITIAL_POSE = ("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")
TOLD_S = 1.0  # from one pose that is heard to the next
OFF_UNIT = 0.01  # of a quaternion's length squared
ANSWER_BYTES = 10_000
LARGEST_HEARD, MOST_WAITING_BYTES = 2 << 20, 32 << 20  # of one message, and of all that wait


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description="Show a rover in ROS 2.")
    parser.add_argument("--rover", required=True, help="name of the rover in its configuration")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7448", help="zenoh endpoint of the rover or a router")
    parser.add_argument("--zenoh", help="zenoh configuration with the certificate for a fleet's router")
    parser.add_argument("--namespace", type=ros_name, help="default: the rover's name")
    parser.add_argument(
        "--frame-prefix", type=ros_name, help="default: the rover's name; '' for map, odom, base_link, laser"
    )
    return parser.parse_args()


def ros_name(text: str) -> str:
    """Names with / between them, or nothing, as ROS 2 takes them."""
    words = text.strip("/")
    if words and (len(words) > 100 or not re.fullmatch(r"([A-Za-z_]\w*/)*[A-Za-z_]\w*", words, re.ASCII)):
        raise argparse.ArgumentTypeError(repr(text) + " is not a valid ROS 2 name: expected one such as fleet/rover1")
    return words


def message_class(type_name: str) -> Any:
    """The class of a type, None where its package is not installed."""
    package, _, name = type_name.split("/")
    try:
        return getattr(import_module(package + ".msg"), name)
    except ImportError:
        return None


def rename(message: Any, prefix: str) -> None:
    """Put the frames of a message behind a prefix."""
    if hasattr(message, "header") and message.header.frame_id:
        message.header.frame_id = prefix + "/" + message.header.frame_id
    if hasattr(message, "child_frame_id"):
        message.child_frame_id = prefix + "/" + message.child_frame_id
    for name in ("transforms", "markers", "poses"):
        for part in getattr(message, name, ()):
            rename(part, prefix)


def words_of(message: Any, prefix: str) -> str:
    """X,Y,YAW,SIGMA_M,SIGMA_RAD of a pose in the map; without the last two where its covariance is zero.

    Raises ValueError with a sentence where the frame is another one, or the quaternion is none of a rotation.
    """
    frame, map_frame = str(message.header.frame_id).lstrip("/"), prefix + "/map" if prefix else "map"
    if frame not in ("", "map", map_frame):
        raise ValueError("is in the frame " + repr(frame) + ", expected " + repr(map_frame))
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    length_squared = turn.x * turn.x + turn.y * turn.y + turn.z * turn.z + turn.w * turn.w
    if not abs(length_squared - 1.0) < OFF_UNIT:
        raise ValueError("has a quaternion whose length squared is " + f"{length_squared:.3g}" + ", expected 1")
    yaw = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z))
    words, spread = [at.x, at.y, yaw], [float(value) for value in message.pose.covariance]
    if any(spread) and all(map(math.isfinite, spread)):
        half, cross = 0.5 * (spread[0] + spread[7]), 0.5 * (spread[1] + spread[6])
        largest = half + math.hypot(0.5 * (spread[0] - spread[7]), cross)
        words += [math.sqrt(max(largest, 0.0)), math.sqrt(max(spread[35], 0.0))]
    return ",".join(f"{word:.9g}" for word in words)


def tell(session: Any, rover: str, words: str) -> str:
    """Tell the rover where it is; what it answers."""
    key = "infant/" + rover + "/command/initial_pose"
    for reply in session.get(key, payload=words.encode(), timeout=ASK_S):
        said = reply.ok or reply.err
        if said is not None and len(said.payload) <= ANSWER_BYTES:
            with suppress(ValueError, RecursionError):
                answer = json.loads(said.payload.to_bytes())
                if isinstance(answer, dict):
                    reason = "".join(c for c in str(answer.get("reason", "")) if c.isprintable())
                    return (
                        "the rover searches its map there" if answer.get("accepted") is True else "refused: " + reason
                    )
    return (
        "refused: " + rover + " does not answer; is publish.commands on, and does its access rule allow this computer?"
    )


class Bridge:
    """Publishers of one rover on one node."""

    def __init__(self, node: Any, prefix: str) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # type: ignore[import-not-found]

        self.prefix = prefix
        self.publishers: dict[str, tuple[Any, Any]] = {}
        self.troubles: set[str] = set()
        for key, (topic, type_name, reliable, latched, depth) in TOPICS.items():
            kind = message_class(type_name)
            if kind is None:
                sys.stderr.write("no package for " + type_name + " here: " + topic + " is left out\n")
                continue
            qos = QoSProfile(depth=depth)
            qos.reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            self.publishers[key] = (kind, node.create_publisher(kind, topic, qos))

    def send(self, key: str, data: bytes) -> None:
        """Publish one message; one that no rover sends is left out, and said once for each key."""
        try:
            self._send(key, data)
        except Exception as error:  # noqa: BLE001 whatever ROS makes of foreign bytes
            if key not in self.troubles:
                self.troubles.add(key)
                sys.stderr.write("a " + key + " that no rover sends is left out: " + ascii(str(error)[:200]) + "\n")

    def _send(self, key: str, data: bytes) -> None:
        from rclpy.serialization import deserialize_message  # type: ignore[import-not-found]

        kind, publisher = self.publishers[key]
        if self.prefix:
            message = deserialize_message(data, kind)
            rename(message, self.prefix)
            publisher.publish(message)
        else:
            publisher.publish(data)


def reason(error: Exception) -> str:
    """What went wrong without the places in zenoh's source."""
    return re.sub(r" at /\S+:\d+\.?", "", str(error)).strip()


def session_of(zenoh: Any, options: argparse.Namespace) -> Any:
    """A client of the rover. Ends the program with 2 where an option is of no use, with 1 where nobody answers."""
    option = "--zenoh " + str(options.zenoh)
    try:
        config = zenoh.Config.from_file(options.zenoh) if options.zenoh else zenoh.Config()
        config.insert_json5("mode", '"client"')
        option = "--connect " + options.connect
        config.insert_json5("connect/endpoints", json.dumps([options.connect]))
    except zenoh.ZError as error:
        sys.stderr.write("infant_bridge: " + option + ": " + reason(error) + "; correct it\n")
        sys.exit(2)
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/link/rx/max_message_size", str(MOST_WAITING_BYTES))
    config.insert_json5("connect/retry", "{period_init_ms:500,period_max_ms:1000,period_increase_factor:2}")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        sys.exit("infant_bridge: " + options.connect + ": no connection (" + reason(error) + "); give --connect")


def follow(zenoh: Any, session: Any, rover: str, node: Any, bridge: Bridge, stop: threading.Event) -> None:
    """Until `stop`: what the rover says, where its laser sits, asked for whenever the rover comes, and the poses that
    it is told.
    """
    import rclpy  # type: ignore[import-not-found]

    def ask(words: str) -> None:
        sys.stderr.write("initial pose " + words + ": " + tell(session, rover, words) + "\n")

    next_told_s = 0.0

    def told(message: Any) -> None:
        nonlocal next_told_s
        if time.monotonic() < next_told_s:
            return  # a flood would be a thread for each
        next_told_s = time.monotonic() + TOLD_S
        try:
            words = words_of(message, bridge.prefix)
        except ValueError as error:
            sys.stderr.write("initial pose: " + str(error) + "\n")
            return
        threading.Thread(target=ask, args=(words,), daemon=True).start()  # what the rover says goes on meanwhile

    topic, type_name = INITIAL_POSE
    node.create_subscription(message_class(type_name), topic, told, 1)
    waiting: queue.Queue[tuple[str, bytes]] = queue.Queue(500)
    came, counting = threading.Event(), threading.Lock()
    below = "infant/" + rover + "/"

    def into(key: str) -> Any:
        def keep(sample: Any) -> None:
            with counting:
                waiting_bytes = sum(len(data) for _, data in waiting.queue)
                size = len(sample.payload)
                if not waiting.full() and size <= LARGEST_HEARD and waiting_bytes + size <= MOST_WAITING_BYTES:
                    waiting.put((key, sample.payload.to_bytes()))

        return zenoh.handlers.Callback(keep, indirect=False)

    def alive(sample: Any) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            came.set()

    heard = [session.declare_subscriber(below + key, into(key)) for key in bridge.publishers if key != "tf_static"]
    callback = zenoh.handlers.Callback(alive, indirect=False)
    heard.append(session.liveliness().declare_subscriber(below + "alive", callback, history=True))
    while not stop.is_set():
        if came.is_set() and "tf_static" in bridge.publishers:
            came.clear()
            for reply in session.get(below + "tf_static", timeout=ASK_S):
                if reply.ok is not None and len(reply.ok.payload) <= LARGEST_HEARD:
                    bridge.send("tf_static", reply.ok.payload.to_bytes())
        rclpy.spin_once(node, timeout_sec=0.0)
        with suppress(queue.Empty):
            bridge.send(*waiting.get(timeout=WAKE_S))


def main() -> None:
    """Follow one rover until a signal."""
    options = arguments()
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions  # type: ignore[import-not-found]
    except ImportError as error:
        sys.exit("infant_bridge: no ROS 2 here (" + str(error) + "); source /opt/ros/DISTRIBUTION/setup.bash first")
    try:
        import zenoh
    except ImportError:
        sys.exit("infant_bridge: the package zenoh is not here; pip install eclipse-zenoh")
    own = re.sub("[^A-Za-z0-9_]", "_", options.rover)
    own = "rover_" + own if own[0].isdigit() else own
    namespace = own if options.namespace is None else options.namespace
    prefix = own if options.frame_prefix is None else options.frame_prefix
    stop = threading.Event()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = rclpy.create_node("infant", namespace=namespace)
    try:
        with session_of(zenoh, options) as session:
            follow(zenoh, session, options.rover, node, Bridge(node, prefix), stop)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
