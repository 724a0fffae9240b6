"""What every bridge does: hands a rover's messages to the writers of another world, with a grid made of them."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Protocol, TextIO

from runtime.bridge.frame_prefix import with_prefix
from runtime.bridge.initial_pose import INITIAL_POSE, words_of
from runtime.bridge.topics import ASKED, MADE, BridgedTopic
from runtime.commands import Command
from runtime.errors import ConfigurationError
from runtime.maps.grid_message import grid_bytes
from runtime.maps.live_grid import LiveGrid
from runtime.printable import printable, tell
from runtime.publish.commands import Answer
from runtime.publish.follow import Follower, Message
from runtime.ros2.vehicle import Frames
from runtime.settings.configuration import load_configuration_text

WAKE_S = 0.2
GRID_S = 2.0
TOLD_S = 1.0  # from one pose that is heard to the next: nobody clicks faster
SCAN_S = 0.5  # from one scan that counts in the grid to the next


class Writer(Protocol):
    """Where the messages of one topic go."""

    def write(self, data: bytes) -> None:
        """One message in CDR."""


class Bridge:
    """Hands each message of a rover to the writer of its topic. sent: how many, by topic; troubles: each kind once;
    answers: what the rover said to poses that it was told.
    """

    def __init__(self, writers: dict[str, tuple[BridgedTopic, Writer]], frames: Frames) -> None:
        self._writers, self._frames = writers, frames
        self.sent: Counter[str] = Counter()
        self.troubles: dict[str, str] = {}
        self.answers: SimpleQueue[str] = SimpleQueue()
        self._next_told_s, self._told_once = -math.inf, True

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

    def tell(self, message: Any, follower: Follower, now_s: float) -> None:
        """A pose that somebody in ROS 2 says the rover has, to the rover; one a second, and a flood is said."""
        if now_s < self._next_told_s:
            if self._told_once:
                self.answers.put(f"a pose on {INITIAL_POSE.name} is ignored: it came within {TOLD_S:g} s of another")
            self._told_once = False
            return
        self._next_told_s, self._told_once = now_s + TOLD_S, True
        try:
            words = words_of(message, self._frames)
        except ValueError as error:
            self.answers.put(f"a pose on {INITIAL_POSE.name} is ignored: {printable(str(error), 200)}")
            return

        def heard(answer: Answer) -> None:
            said = "the rover searches its map there" if answer.accepted else f"refused: {answer.reason}"
            self.answers.put(f"initial pose {words}: {said}")

        follower.command(Command.INITIAL_POSE, words, heard)


def run_bridge(
    follower: Follower,
    bridge: Bridge,
    told_pose: Callable[[], Any],
    resolution_m: float | None,
    stop: threading.Event,
    said: TextIO,
) -> None:
    """Until `stop`. told_pose: a pose that somebody says the rover has, None where there is none."""
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
        if (pose := told_pose()) is not None:
            bridge.tell(pose, follower, now_s)
        while not bridge.answers.empty():
            tell(said, f"infant: {bridge.answers.get()}\n")
        troubles = [*bridge.troubles.values(), *(() if grid is None else grid.troubles.values())]
        for text in troubles[told:]:
            tell(said, f"infant: {text}\n")
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
