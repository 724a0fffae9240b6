"""What a rover says and records, made from the tables by which it does so."""

import inspect
import json
from dataclasses import dataclass

import numpy as np

from drivers.measurements import Event, SensorHealth, SensorState
from runtime.commands import Command
from runtime.health import Health, RunState
from runtime.messages.definitions import DEFINITIONS, TYPES
from runtime.messages.map_json import landmark_json
from runtime.publish import messages, ros2_keys
from runtime.publish.commands import command_key
from runtime.publish.topics import ROS2_TYPES, ros2_topic
from runtime.ros2.markers import MARKERS
from runtime.ros2.poses import PATH, POSES
from runtime.ros2.transforms import TF
from runtime.tick import CompletedTick, SinkHealth, Tick, Timing
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.pose import Pose2


@dataclass(frozen=True, slots=True)
class Key:
    """One key below infant/<rover>/: its encoding as zenoh carries it, how often, what it is for."""

    name: str
    encoding: str
    pace: str
    meaning: str


PUBLISHED = (
    Key("pose", f"application/cdr;{TYPES['/pose']}", "every tick", "the pose in the frame `map`, with its covariance"),
    Key("odom", f"application/cdr;{TYPES['/odom']}", "every tick", "dead reckoning: pose in `odom`, twist in the body"),
    Key("tf", f"application/cdr;{TF}", "every tick, if subscribed to", "`map` to `odom` to `base_link`"),
    Key("scan", f"application/cdr;{TYPES['/scan']}", "`publish.scan_hz`", "every third beam"),
    Key("scan_full", f"application/cdr;{TYPES['/scan']}", "every scan, if subscribed to", "all beams"),
    Key("particles", f"application/cdr;{POSES}", "once a second, if subscribed to", "poses of the particles"),
    Key("path", f"application/cdr;{PATH}", "once a second, if subscribed to", "the path so far, thinned"),
    Key("landmarks", f"application/cdr;{MARKERS}", "once a second", "spheres: the surer a landmark, the greener"),
    Key("status", "application/json", "once a second", "state, reasons, pose, sensors and sinks for dashboards"),
    Key("health", f"application/cdr;{messages.DIAGNOSTICS}", "once a second", "every counter of every sensor"),
    Key("event", "application/json", "when it happens", "one event of the log"),
)
ASKED = (
    Key("pose", f"application/cdr;{TYPES['/pose']}", "", "the last pose"),
    Key("status", "application/json", "", "the last status"),
    Key("map", "application/json", "", "all landmarks with covariances and the probability that they exist"),
    Key("path", f"application/cdr;{PATH}", "", "the path so far, thinned"),
    Key("tf_static", f"application/cdr;{TF}", "", "where the laser is mounted: `base_link` to `laser`"),
    Key("configuration", "application/toml", "", "the configuration in force"),
)

HEAD = """# What goes over the wire, and into the record

All numbers are SI; headings are counter-clockwise in radians; frames are those of REP 103 and 105 (`map`, `odom`,
`base_link`, `laser`). Stamps that leave the rover are wall time; inside `run.mcap` they are the host's monotonic clock,
and the head of the file says what the wall clock showed at its start.

This page is generated from the tables that the rover itself uses (`make reference`).
"""


def wire_page() -> str:
    """The page, as Markdown."""
    return "".join((HEAD, _keys(), _commands(), _ros2(), _json(), _record(), _definitions()))


def _keys() -> str:
    below = "infant/<rover>/"
    said = "".join(f"| `{below}{key.name}` | `{key.encoding}` | {key.pace} | {key.meaning} |\n" for key in PUBLISHED)
    asked = "".join(f"| `{below}{key.name}` | `{key.encoding}` | {key.meaning} |\n" for key in ASKED)
    return f"""
## Keys of zenoh

`<rover>` is the key `rover` of the configuration. The liveliness token `infant/<rover>/alive` exists while it runs.

| key | encoding | how often | what it is |
|---|---|---|---|
{said}
Each message carries 33 bytes as its attachment, little-endian: number of the message (int64), wall time in ns (int64),
16 (uint8), and 16 bytes that name the publisher. ROS 2 wants exactly this; others may use it to count losses.

Queries (`session.get`) are answered on these keys:

| key | encoding | answer |
|---|---|---|
{asked}"""


def _commands() -> str:
    rows = "".join(f"| `{command_key('<rover>', command)}` | {_meaning(command)} |\n" for command in Command)
    return f"""
## Commands

Off unless `publish.commands = true`; the rover then requires access rules in `publish.config_file`. A command is a
query with the reason as its payload (UTF-8, at most 1000 characters); the answer is JSON with `accepted` and `reason`.
It becomes an event of the next tick, with source `command`. The last tick of a stopped record holds the event that
stopped it.

| key | what happens |
|---|---|
{rows}"""


def _meaning(command: Command) -> str:
    """The sentence that stands below the member in the source."""
    lines = inspect.getsource(Command).splitlines()
    at = next(k for k, line in enumerate(lines) if line.strip().startswith(f"{command.name} ="))
    return lines[at + 1].strip().strip('"')


def _ros2() -> str:
    topics = {ros2_topic("<rover>", name): type_name for name, type_name in ROS2_TYPES.items()} | {"/tf_static": TF}
    rows = "".join(
        f"| `{topic}` | `{name}` | `{ros2_keys.data_key(0, topic, name)}` |\n" for topic, name in topics.items()
    )
    return f"""
## Keys of ROS 2 (rmw_zenoh)

With `publish.ros2 = true` the rover publishes the following as the node `/<rover>/infant`, with the liveliness tokens
by which `ros2 topic list` finds it. The domain (here 0) is `publish.ros2_domain`. A character that ROS names cannot
have is replaced by `_`. With `publish.ros2 = "humble"` keys and tokens end in `TypeHashNotSupported` instead of the
hash. `/tf_static` is latched. The gid in the attachment is the XXH3 hash (128 bits) of the publisher's token.

| topic | type | key |
|---|---|---|
{rows}"""


def _json() -> str:
    nowhere, doubt = Pose2(1.0, 2.0, 0.5), np.diag((0.04, 0.04, 0.0004))
    estimate = Estimate(0, nowhere, doubt, nowhere, doubt, nowhere, Quality.TRACKING, counts={"landmarks": 42.0})
    landmarks = LandmarkMap(np.array([4096]), np.array([[3.0, 4.0]]), np.array([np.eye(2) * 0.01]), np.array([2.0]))
    laser = SensorHealth(SensorState.FRESH, "", 10.0)
    sinks = {"record": SinkHealth(0, 0), "publish": SinkHealth(0, 0)}
    health = Health(0, RunState.RUNNING, (), {"laser": laser}, sinks, Quality.TRACKING)
    timing = Timing(110_000, 0, {"read": 20_000, "step": 5_000_000})
    completed = CompletedTick(Tick(7, 0, None, ()), estimate, timing, b"", None)
    status = messages.status_object("rover1", WALL_NS, completed, 10.0, health)
    event = json.loads(messages.event_json(Event(0, "laser", "checksum", "one line had a wrong sum"), WALL_NS))
    shown = (("status", status), ("event", event), ("map", json.loads(landmark_json(landmarks, WALL_NS))))
    text = "\n## JSON\n"
    for name, value in shown:
        text += f"\n### {name}\n\n```json\n{json.dumps(value, indent=2)}\n```\n"
    return text


WALL_NS = 1_700_000_000_000_000_000


def _record() -> str:
    rows = "".join(f"| `{topic}` | `{name}` |\n" for topic, name in TYPES.items())
    return f"""
## Topics of run.mcap

Profile `ros2`, messages in CDR, every definition inside the file; Foxglove, rerun and `ros2 bag play` read it without
Infant. Types of the package `infant_msgs` are played only where that package has been built.

| topic | type |
|---|---|
{rows}"""


def _definitions() -> str:
    parts = [f"\n### {name}\n\n```text\n{text.rstrip()}\n```\n" for name, text in DEFINITIONS.items()]
    return "\n## Own message definitions\n" + "".join(parts)
