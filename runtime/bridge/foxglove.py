"""infant bridge foxglove: a process of its own from a rover's zenoh keys to Foxglove and Lichtblick, over WebSocket."""

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TextIO

from runtime.bridge.bridge import Bridge, run_bridge
from runtime.bridge.topics import HEARD, TOPICS, BridgedTopic
from runtime.errors import SensorError
from runtime.messages.definitions import definition
from runtime.optional_packages import needs
from runtime.printable import tell
from runtime.publish.find_rover import find_rover
from runtime.publish.follow import following
from runtime.ros2.vehicle import Frames

BACKLOG = 32  # messages that are kept for a client that does not read, for each anew: 1024 took 1 GB for 40 of them
MOST_CLIENTS = (
    20  # who get messages, the last that came: each may keep 1.3 MB and more waiting, and none can be put out
)
STOP_S = 2.0  # the server waits without end for whoever does not read its goodbye


@dataclass(frozen=True, slots=True)
class FoxgloveOptions:
    """What the command was asked for. resolution_m: of the grid, None: no grid."""

    connect: str | None = None
    rover: str | None = None
    config_file: str | None = None
    host: str = "127.0.0.1"
    port: int = 8765
    resolution_m: float | None = 0.1


class FoxgloveServer:
    """Serves topics to whoever connects, and takes nothing. port: where it listens, also if 0 was asked for."""

    def __init__(self, rover: str, host: str, port: int) -> None:
        """Raises UsageError where foxglove-sdk is not installed, SensorError where the address cannot be used."""
        with needs("foxglove", "infant bridge foxglove"):
            import foxglove
            from foxglove.websocket import ServerListener

        foxglove.set_log_level("CRITICAL")  # it says nothing then: else clients would choose what is said here
        channels, clients = dict[str, _Channel](), Clients()
        self._channels, self.clients = channels, clients

        class Latecomers(ServerListener):
            """What is said once is said again to whoever comes later."""

            def on_subscribe(self, client: Any, channel: Any) -> None:
                clients.subscribe(client.id, channel.topic)
                channels[channel.topic].repeat(client.id)

            def on_unsubscribe(self, client: Any, channel: Any) -> None:
                clients.unsubscribe(client.id, channel.topic)

        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=rover,
                host=host,
                port=port,
                server_listener=Latecomers(),
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except (RuntimeError, ValueError, OSError, OverflowError) as error:
            why = re.sub(r"^\w*Error: (Failed to bind port: )?| \(os error \d+\)$", "", str(error))
            raise SensorError(f"{host}:{port} cannot be served: {why}; give others with --host and --port") from error
        self.port: int = self._server.port

    def writer(self, topic: BridgedTopic) -> "_Channel":
        """Where the messages of a topic go."""
        from foxglove import Channel, Schema

        schema = Schema(name=topic.type_name, encoding="ros2msg", data=definition(topic.type_name).encode())
        channel = Channel(topic.name, schema=schema, message_encoding="cdr", context=self._context)
        self._channels[topic.name] = _Channel(channel, topic.latched, partial(self.clients.of, topic.name))
        return self._channels[topic.name]

    def close(self) -> None:
        """Whoever watches is let go."""
        stopping = threading.Thread(target=self._server.stop, name="foxglove-stop", daemon=True)
        stopping.start()
        stopping.join(STOP_S)


class Clients:
    """Who has subscribed to what, by the numbers that the library gives them; told by its threads."""

    def __init__(self) -> None:
        self._topics: dict[int, set[str]] = {}  # who came first is first
        self._lock = threading.Lock()

    def subscribe(self, client: int, topic: str) -> None:
        """To one topic more."""
        with self._lock:
            self._topics.setdefault(client, set()).add(topic)

    def unsubscribe(self, client: int, topic: str) -> None:
        """From one; whoever goes leaves all of them."""
        with self._lock:
            topics = self._topics.get(client, set())
            topics.discard(topic)
            if not topics:
                self._topics.pop(client, None)

    def of(self, topic: str) -> list[int]:
        """Who gets its messages: of the last that came those who asked for it."""
        with self._lock:
            return [client for client in list(self._topics)[-MOST_CLIENTS:] if topic in self._topics[client]]


class _Channel:
    """A topic; latched: its last message is kept for those who come later. clients: who gets its messages now."""

    def __init__(self, channel: Any, latched: bool, clients: Callable[[], list[int]]) -> None:
        self._channel, self._latched, self._clients = channel, latched, clients
        self._last: bytes | None = None

    def write(self, data: bytes) -> None:
        """To those who have subscribed."""
        if self._latched:
            self._last = data
        for client in self._clients():
            self._channel.log(data, log_time=time.time_ns(), sink_id=client)

    def repeat(self, client: int) -> None:
        """The last message, where one is kept, to one of them."""
        if self._last is not None and client in self._clients():
            self._channel.log(self._last, log_time=time.time_ns(), sink_id=client)


def bridge_foxglove(options: FoxgloveOptions, stop: threading.Event, said: TextIO) -> dict[str, Any]:
    """Run until `stop`; returns what was sent. said: gets where it is, and each kind of trouble once.

    Raises UsageError, SensorError, ConfigurationError.
    """
    rover = find_rover(options.connect, options.rover, options.config_file)
    server = FoxgloveServer(rover.name, options.host, options.port)
    try:
        bridge = Bridge({topic.key: (topic, server.writer(topic)) for topic in TOPICS}, Frames())
        url = f"ws://{options.host}:{server.port}"
        tell(said, f"infant: {rover.name} is served to Foxglove and Lichtblick at {url}\n")
        with following(rover, HEARD, options.config_file) as follower:
            run_bridge(follower, bridge, lambda: None, options.resolution_m, stop, said)
    finally:
        server.close()
    return {"rover": rover.name, "sent": dict(sorted(bridge.sent.items()))}
