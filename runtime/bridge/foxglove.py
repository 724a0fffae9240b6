"""infant bridge foxglove: a process of its own from a rover's zenoh keys to Foxglove and Lichtblick, over WebSocket."""

import re
import threading
import time
from dataclasses import dataclass
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
        channels = self._channels = dict[str, _Channel]()

        class Latecomers(ServerListener):
            """What is said once is said again to whoever comes later."""

            def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
                channels[channel.topic].repeat()

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
        self._channels[topic.name] = _Channel(channel, topic.latched)
        return self._channels[topic.name]

    def close(self) -> None:
        """Whoever watches is let go."""
        stopping = threading.Thread(target=self._server.stop, name="foxglove-stop", daemon=True)
        stopping.start()
        stopping.join(STOP_S)


class _Channel:
    """A topic; latched: its last message is kept for those who come later."""

    def __init__(self, channel: Any, latched: bool) -> None:
        self._channel, self._latched = channel, latched
        self._last: bytes | None = None

    def write(self, data: bytes) -> None:
        """To all who have subscribed."""
        if self._latched:
            self._last = data
        self._channel.log(data, log_time=time.time_ns())

    def repeat(self) -> None:
        """The last message, where one is kept."""
        if self._last is not None:
            self._channel.log(self._last, log_time=time.time_ns())


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
