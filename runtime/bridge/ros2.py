"""infant bridge ros2: a process of its own from a rover's zenoh keys to DDS, which stock ROS 2 speaks."""

import threading
import time
from collections import Counter
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, TextIO

from runtime.bridge.dds import LOOPBACK, DdsParticipant, RawWriter, TypedReader
from runtime.bridge.frame_prefix import with_prefix
from runtime.bridge.initial_pose import INITIAL_POSE, words_of
from runtime.bridge.topics import ASKED, HEARD, MADE, TOPICS, BridgedTopic, in_namespace
from runtime.commands import Command
from runtime.errors import ConfigurationError, UsageError
from runtime.maps.grid_message import grid_bytes
from runtime.maps.live_grid import LiveGrid
from runtime.printable import printable
from runtime.publish.commands import Answer
from runtime.publish.find_rover import find_rover
from runtime.publish.follow import Follower, Message, following
from runtime.publish.ros2_keys import ros_name
from runtime.ros2.vehicle import Frames
from runtime.settings.configuration import load_configuration_text

WAKE_S = 0.2
GRID_S = 2.0
SCAN_S = 0.5  # from one scan that counts in the grid to the next
MOST_DOMAIN = 232


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


class Bridge:
    """Hands each message of a rover to the writer of its topic. sent: how many, by topic; troubles: each kind once;
    answers: what the rover said to poses that it was told.
    """

    def __init__(self, writers: dict[str, tuple[BridgedTopic, RawWriter]], frames: Frames) -> None:
        self._writers, self._frames = writers, frames
        self.sent: Counter[str] = Counter()
        self.troubles: dict[str, str] = {}
        self.answers: SimpleQueue[str] = SimpleQueue()

    def take(self, message: Message) -> None:
        """A message of the rover, or one that was made here."""
        topic, writer = self._writers[message.name]
        try:
            data = with_prefix(topic.type_name, message.data, self._frames)
        except ValueError as error:
            text = f"a {message.name} that no rover sends is ignored: {printable(str(error), 200)}"
            self.troubles.setdefault(message.name, text)
            return
        writer.write(data)
        self.sent[topic.name] += 1

    def tell(self, message: Any, follower: Follower) -> None:
        """A pose that somebody in ROS 2 says the rover has, to the rover."""
        try:
            words = words_of(message, self._frames)
        except ValueError as error:
            self.answers.put(f"a pose on {INITIAL_POSE.name} is ignored: {printable(str(error), 200)}")
            return

        def heard(answer: Answer) -> None:
            said = "the rover searches its map there" if answer.accepted else f"refused: {answer.reason}"
            self.answers.put(f"initial pose {words}: {said}")

        follower.command(Command.INITIAL_POSE, words, heard)


def bridge_ros2(options: BridgeOptions, stop: threading.Event, said: TextIO) -> dict[str, Any]:
    """Run until `stop`; returns what was sent. said: gets where it is, and each kind of trouble once.

    Raises UsageError, SensorError, ConfigurationError.
    """
    if not 0 <= options.domain <= MOST_DOMAIN:
        raise UsageError(f"--domain {options.domain}: expected 0 to {MOST_DOMAIN}, the ROS_DOMAIN_ID of the nodes")
    rover = find_rover(options.connect, options.rover, options.config_file)
    own = ros_name(rover.name)
    namespace = own if options.namespace is None else options.namespace.strip("/")
    frames = Frames(own if options.frame_prefix is None else options.frame_prefix.strip("/"))
    participant = DdsParticipant(options.domain, options.interface)
    topics = [in_namespace(topic, namespace) for topic in TOPICS]
    bridge = Bridge({topic.key: (topic, participant.writer(topic)) for topic in topics}, frames)
    said.write(
        f"infant: {rover.name} at {rover.endpoint} is in ROS 2 domain {options.domain} on {options.interface}: "
        f"{', '.join(topic.name for topic in topics)}\n"
    )
    with following(rover, HEARD, options.config_file) as follower:
        poses = participant.reader(in_namespace(INITIAL_POSE, namespace))
        _run(follower, bridge, poses, options.resolution_m, stop, said)
    return {"rover": rover.name, "sent": dict(sorted(bridge.sent.items()))}


def _run(
    follower: Follower,
    bridge: Bridge,
    poses: TypedReader,
    resolution_m: float | None,
    stop: threading.Event,
    said: TextIO,
) -> None:
    grid: LiveGrid | None = None
    told, next_grid_s, next_scan_s = 0, 0.0, 0.0
    while not stop.is_set():
        if follower.has_come():
            grid = _begin(follower, bridge, resolution_m)
        message, now_s = follower.next(WAKE_S), time.monotonic()
        if message is not None:
            bridge.take(message)
            if grid is not None and message.name == "pose":
                grid.take("pose", message.data)
            elif grid is not None and message.name == "scan_full" and now_s >= next_scan_s:
                next_scan_s = now_s + SCAN_S
                grid.take("scan", message.data)
        if grid is not None and grid.grid.scans and now_s >= next_grid_s:
            next_grid_s = now_s + GRID_S
            bridge.take(Message(MADE, grid_bytes(grid.grid.grid_map(), time.time_ns())))
        if (told_pose := poses.take()) is not None:
            bridge.tell(told_pose, follower)
        while not bridge.answers.empty():
            said.write(f"infant: {bridge.answers.get()}\n")
        troubles = [*bridge.troubles.values(), *(() if grid is None else grid.troubles.values())]
        for text in troubles[told:]:
            said.write(f"infant: {text}\n")
        told = max(told, len(troubles))


def _begin(follower: Follower, bridge: Bridge, resolution_m: float | None) -> LiveGrid | None:
    """What a rover says only when it is asked; a new run begins a new grid."""
    static = follower.ask(ASKED)
    if static is not None:
        bridge.take(Message(ASKED, static))
    text = follower.ask("configuration")
    if text is None or resolution_m is None:
        return None
    try:
        settings = load_configuration_text(text.decode(), source=f"configuration of {follower.rover}").slam
    except (ConfigurationError, UnicodeDecodeError) as error:
        bridge.troubles["configuration"] = f"no grid: {printable(str(error), 300)}"
        return None
    return LiveGrid(settings, resolution_m)
