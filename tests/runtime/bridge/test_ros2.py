"""The bridge hands CDR to DDS as it is, names topics and frames per rover, and says what is wrong in one sentence."""

import argparse
import ast
import json
import math
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zenoh
from typer.testing import CliRunner

from runtime.bridge import rclpy_node
from runtime.bridge.bridge import Bridge
from runtime.bridge.frame_prefix import with_prefix
from runtime.bridge.ros2 import BridgeOptions, bridge_ros2
from runtime.bridge.topics import TOPICS, in_namespace
from runtime.cli.__main__ import app
from runtime.errors import SensorError, UsageError
from runtime.messages.definitions import deserialize
from runtime.publish.find_rover import endpoint_of, find_rover
from runtime.publish.follow import Message, following
from runtime.ros2.transforms import TF, transform_bytes
from runtime.ros2.vehicle import PLAIN, Frames
from slam.pose import Pose2
from tests.support.runtime.recorded_values import make_estimate
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

NOBODY = "tcp/127.0.0.1:1"


class Written:
    """Takes the place of a DDS writer."""

    def __init__(self) -> None:
        self.data: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.data.append(data)


def bridge(frames: Frames) -> tuple[Bridge, dict[str, Written]]:
    writers = {topic.key: Written() for topic in TOPICS}
    named: Any = {topic.key: (in_namespace(topic, "r1"), writers[topic.key]) for topic in TOPICS}
    return Bridge(named, frames), writers


def tf_of(pose: Pose2) -> bytes:
    return transform_bytes(1_700_000_000_000_000_000, pose, Pose2(1.0, 0.0, 0.1))


def test_without_a_prefix_every_byte_goes_through_as_it_came() -> None:
    made, writers = bridge(PLAIN)
    data = tf_of(Pose2(1.0, 2.0, 0.3))
    made.take(Message("tf", data))
    assert writers["tf"].data == [data]
    assert made.sent == {"/tf": 1}


def test_with_a_prefix_two_rovers_do_not_share_a_tree_of_frames() -> None:
    made, writers = bridge(Frames("r1"))
    made.take(Message("tf", tf_of(Pose2(1.0, 2.0, 0.3))))
    links = [(each.header.frame_id, each.child_frame_id) for each in deserialize(TF, writers["tf"].data[0]).transforms]
    assert links == [("r1/map", "r1/odom"), ("r1/odom", "r1/base_link")]
    names = {in_namespace(topic, "r1").name for topic in TOPICS}
    assert {"/r1/scan", "/r1/map", "/tf", "/tf_static", "/diagnostics"} <= names


def test_what_no_rover_sends_is_passed_over_and_named_once() -> None:
    made, writers = bridge(Frames("r1"))
    for _ in range(3):
        made.take(Message("pose", b"junk"))
    assert writers["pose"].data == []
    assert len(made.troubles) == 1
    with pytest.raises(ValueError, match="not the bytes"):
        with_prefix(TF, b"\0\1\0\0junk", Frames("r1"))


def test_the_file_for_machines_with_ros_has_the_same_topics_and_imports_nothing_of_ours() -> None:
    ours = {each.key: each for each in TOPICS}
    assert rclpy_node.TOPICS.keys() == ours.keys()
    for key, (name, type_name, reliable, latched, depth) in rclpy_node.TOPICS.items():
        each = ours[key]
        assert in_namespace(each, "r1").name == (name if name.startswith("/") else f"/r1/{name}")
        assert (each.type_name, each.reliable, each.latched, each.depth) == (type_name, reliable, latched, depth)
    tree = ast.parse(Path(rclpy_node.__file__).read_text())
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {name for name in imported if name.split(".")[0] in ("runtime", "drivers", "slam")}
    assert {name.split(".")[0] for name in imported} <= {*sys.stdlib_module_names, "rclpy", "zenoh"}


def test_a_renamed_message_of_rclpy_is_renamed_throughout() -> None:
    link = SimpleNamespace(header=SimpleNamespace(frame_id="map"), child_frame_id="odom")
    message = SimpleNamespace(transforms=[link])
    rclpy_node.rename(message, "r1")
    assert (link.header.frame_id, link.child_frame_id) == ("r1/map", "r1/odom")


def test_the_file_is_written_and_never_over_another(tmp_path: Path) -> None:
    target, runner = tmp_path / "bridge.py", CliRunner()
    assert runner.invoke(app, ["bridge", "rclpy", "--out", str(target), "--json"]).exit_code == 0
    assert target.read_text() == Path(rclpy_node.__file__).read_text()
    assert "nothing is overwritten" in str(runner.invoke(app, ["bridge", "rclpy", "--out", str(target)]).exception)


@pytest.mark.parametrize(
    ("said", "endpoint"),
    [
        ("tcp/1.2.3.4:7447", "tcp/1.2.3.4:7447"),
        ("rover1.local", "tcp/rover1.local:7448"),
        ("rover1:7449", "tcp/rover1:7449"),
    ],
)
def test_a_host_is_an_endpoint_too(said: str, endpoint: str) -> None:
    assert endpoint_of(said) == endpoint


def test_nobody_there_and_words_that_make_no_sense_are_one_sentence() -> None:
    with pytest.raises(SensorError, match="no rover answers at tcp"):
        find_rover(NOBODY, None)
    with pytest.raises(SensorError, match="r1 does not answer"):
        find_rover(NOBODY, "r1")
    with pytest.raises(UsageError, match="--rover 'a/b'"):
        find_rover(NOBODY, "a/b")
    with pytest.raises(UsageError, match="--domain 300"):
        bridge_ros2(BridgeOptions(connect=NOBODY, domain=300), None, sys.stderr)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["a b", "1st", "fleet//rover", "x" * 101, "rövér", "a\n"])
def test_a_name_that_ros_2_cannot_have_is_one_sentence(name: str) -> None:
    for option, asked in (
        ("--namespace", BridgeOptions(NOBODY, namespace=name)),
        ("--frame-prefix", BridgeOptions(NOBODY, frame_prefix=name)),
    ):
        with pytest.raises(UsageError, match=rf"{option} .*as in fleet/rover1"):
            bridge_ros2(asked, threading.Event(), sys.stderr)
        with pytest.raises(argparse.ArgumentTypeError, match="fleet/rover1"):
            rclpy_node.ros_name(name)
    assert rclpy_node.ros_name("/fleet/rover_1/") == "fleet/rover_1"


def test_a_rover_is_followed_from_endpoint_to_message_and_answers_where_its_laser_sits() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(3), 0.0)
        rover = None

        def answers() -> bool:
            nonlocal rover
            try:
                rover = find_rover(f"127.0.0.1:{port}", None)
            except SensorError:
                return False
            return True

        assert until(answers)
        assert rover is not None
        with following(rover, ("tf", "scan_full", "particles", "path")) as follower:
            assert until(lambda: follower.is_there)
            assert follower.has_come()
            assert not follower.has_come()
            assert deserialize(TF, follower.ask("tf_static") or b"").transforms[0].child_frame_id == "laser"
            assert follower.ask("nothing") is None
            names: set[str] = set()

            def all_came() -> bool:
                put_ticks(publisher, range(100 + 50 * len(names), 150 + 50 * len(names)), 0.0)
                while (message := follower.next(0.1)) is not None:
                    names.add(message.name)
                return len(names) == 4

            assert until(all_came), names


def test_a_typed_reader_of_dds_reads_what_was_written_raw() -> None:
    dds = pytest.importorskip("cyclonedds.sub", reason="cyclonedds has no wheel for this machine")
    from runtime.bridge.dds import DdsParticipant, idl_type

    topic = next(topic for topic in TOPICS if topic.key == "tf_static")
    participant = DdsParticipant(178, "lo")
    writer = participant.writer(topic)
    pose = make_estimate(0, np.random.default_rng(1)).map_from_body
    writer.write(tf_of(pose))  # before anyone listens: it is latched
    from cyclonedds.core import Policy, Qos
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    latched = Qos(Policy.Durability.TransientLocal, Policy.Reliability.Reliable(duration(seconds=1)))
    late = dds.DataReader(
        participant._participant, Topic(participant._participant, "rt/tf_static", idl_type(TF)), qos=latched
    )
    samples: list[Any] = []

    def came() -> bool:
        samples.extend(late.take(10))
        return bool(samples)

    assert until(came)
    chain = Pose2()
    for each in samples[0].transforms:
        at, turn = each.transform.translation, each.transform.rotation
        chain = chain @ Pose2(at.x, at.y, 2.0 * math.atan2(turn.z, turn.w))
    np.testing.assert_allclose(chain.as_array(), pose.as_array(), atol=1e-9)
    with pytest.raises(SensorError, match="no network interface 'nowhere0' here; --interface takes one of lo"):
        DdsParticipant(179, "nowhere0")


def test_json_of_the_command_is_one_object(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["bridge", "rclpy", "--out", str(tmp_path / "b.py"), "--json"])
    assert json.loads(result.stdout)["file"].endswith("b.py")


@pytest.mark.parametrize(
    ("connect", "file", "code", "sentence"),
    [
        ("nonsense", None, 2, "--connect nonsense: "),
        ("tcp/127.0.0.1:7448", "nowhere.json5", 2, "--zenoh nowhere.json5: No such file"),
        ("tcp/127.0.0.1:1", None, 1, "tcp/127.0.0.1:1: no connection"),
    ],
)
def test_the_node_ends_with_one_sentence_where_it_cannot_begin(
    connect: str, file: str | None, code: int, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        rclpy_node.session_of(zenoh, argparse.Namespace(connect=connect, zenoh=file))
    said = capsys.readouterr().err if code == 2 else str(ended.value.code)
    assert (ended.value.code == 2) == (code == 2)
    assert said.startswith(f"infant_bridge: {sentence}")
    assert " at /" not in said
