"""Zenoh sessions with explicit endpoints: nothing is scouted by multicast or gossip unless a file asks for it."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import zenoh

from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError
from runtime.publish.access import bound, command_trouble
from runtime.settings.publish import PublishSettings

LEASE_MS = 3000  # ms of silence after which a peer is taken for gone; zenoh's 10 s is long on Wi-Fi
OPEN_MS = 3000  # that a tool waits for whoever accepts and says nothing; it may ask at six endpoints, one by one
URGENT_WAITING = 16  # messages; zenoh's 2 lose one where a busy machine lets pose, odom and tf of a tick wait for 1 ms
PORTS_TO_TRY = 20
LARGEST_ANSWER = 16 << 20  # bytes that a tool takes from a rover: a map of 50 000 landmarks
LARGEST_FILE = 1 << 20
DEEPEST = 64  # brackets in brackets of a configuration; the library's reader ends the process beyond some thousands
RETRY = "{period_init_ms:500,period_max_ms:1000,period_increase_factor:2}"


def rover_config(settings: PublishSettings, rover: str, listen: Sequence[str]) -> zenoh.Config:
    """A peer: it never waits for a router to be there, and connects to it whenever it comes.

    rover: its name, whose keys the access rules have to guard where commands are on. Raises ConfigurationError when
    the settings' file cannot be used, or its rules do not say who may command.
    """
    named = settings.config_file
    config = _from_file("publish.config_file", named) if named is not None else _silent(zenoh.Config())
    if settings.commands and (trouble := command_trouble(config, rover)):
        raise ConfigurationError(
            f"publish.commands = True: {trouble}; correct {settings.config_file} as in "
            "config/zenoh-rover.json5, or leave commands off"
        )
    bound(config)
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", json.dumps(list(listen)))
    config.insert_json5("connect/endpoints", json.dumps(list(settings.connect)))
    config.insert_json5("connect/retry", RETRY)
    config.insert_json5("transport/link/tx/lease", json.dumps(LEASE_MS))
    config.insert_json5("transport/link/tx/queue/size/real_time", json.dumps(URGENT_WAITING))
    if settings.ros2:
        # ROS 2 nodes are peers that learn of each other from their router; it passes no message from peer to peer
        config.insert_json5("scouting/gossip/enabled", "true")
        config.insert_json5("timestamping/enabled", "true")  # what is latched is kept by its stamp
    return config


def tool_config(endpoint: str, config_file: str | None = None) -> zenoh.Config:
    """A client of one rover or router. A peer would not do: routers do not pass messages from peer to peer.

    config_file: zenoh configuration to start from, for certificates. Raises ConfigurationError.
    """
    config = _from_file("--zenoh", config_file) if config_file is not None else _silent(zenoh.Config())
    config.insert_json5("transport/link/rx/max_message_size", json.dumps(LARGEST_ANSWER))
    config.insert_json5("transport/unicast/open_timeout", json.dumps(OPEN_MS))
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/retry", RETRY)
    return config


@contextmanager
def tool_session(endpoint: str, config_file: str | None = None) -> Iterator[zenoh.Session]:
    """A session of a tool for as long as it is used; that no goodbye can be said in time is no trouble of the tool's.

    Raises zenoh.ZError where nobody listens there, ConfigurationError.
    """
    session = zenoh.open(tool_config(endpoint, config_file))
    try:
        yield session
    finally:
        with suppress(zenoh.ZError):  # a peer or a router that is flooded does not answer within zenoh's 10 s
            session.close()  # type: ignore[no-untyped-call]


def open_rover_session(settings: PublishSettings, rover: str) -> tuple[zenoh.Session, tuple[str, ...]]:
    """The session and where it really listens: the next free port where one is taken.

    Raises zenoh.ZError for anything but a taken port.
    """
    listen = settings.listen
    for _ in range(PORTS_TO_TRY):
        try:
            return zenoh.open(rover_config(settings, rover, listen)), listen
        except zenoh.ZError as error:
            if "in use" not in str(error):
                raise
            listen = tuple(next_port(endpoint) for endpoint in listen)
    return zenoh.open(rover_config(settings, rover, ())), ()  # still reached through a router


def next_port(endpoint: str) -> str:
    """tcp/127.0.0.1:7448 becomes tcp/127.0.0.1:7449; port 0, which is never taken, stays."""
    address, port, config = re.fullmatch(r"(.*:)(\d+)(#.*)?", endpoint).groups()  # type: ignore[union-attr]
    return f"{address}{int(port) + 1 if int(port) else 0}{config or ''}"


def short_reason(error: zenoh.ZError) -> str:
    """What went wrong without the places in zenoh's source."""
    return re.sub(r" at /\S+:\d+\.?", "", str(error)).strip()


def _silent(config: zenoh.Config) -> zenoh.Config:
    """What says nothing of scouting does not scout; zenoh would."""
    for key in ("scouting/multicast/enabled", "scouting/gossip/enabled"):
        if config.get_json(key) == "null":
            config.insert_json5(key, "false")
    return config


def _from_file(key: str, path: str) -> zenoh.Config:
    try:
        text = read_bounded(Path(path), LARGEST_FILE)
    except (OSError, ValueError) as error:
        why = "no such file" if isinstance(error, FileNotFoundError) else error
        raise ConfigurationError(f"{key} = {path!r}: {why}; give a zenoh configuration in JSON5") from error
    if _depth(text) > DEEPEST:
        raise ConfigurationError(f"{key} = {path!r}: more than {DEEPEST} nested brackets; correct the file")
    try:
        return _silent(zenoh.Config.from_file(path))
    except zenoh.ZError as error:
        raise ConfigurationError(f"{key} = {path!r}: {short_reason(error)}; correct the file") from error


def _depth(text: bytes) -> int:
    """How many brackets are open at once at most, those in strings and comments counted too."""
    depth = deepest = 0
    for bracket in re.findall(rb"[\[{}\]]", text):
        depth += 1 if bracket in b"[{" else -1
        deepest = max(deepest, depth)
    return deepest
