"""What somebody says in RViz reaches the rover as its command, and the answer reaches him."""

import io
import threading
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runtime.bridge import rclpy_node
from runtime.bridge.bridge import Bridge
from runtime.bridge.initial_pose import words_of
from runtime.bridge.ros2 import BridgeOptions, bridge_ros2
from runtime.commands import Command, command_of, parse_prior
from runtime.errors import SensorError
from runtime.publish.commands import Answer
from runtime.publish.find_rover import find_rover
from runtime.publish.follow import following
from runtime.ros2.poses import POSE, pose_bytes
from runtime.ros2.vehicle import Frames
from slam.pose import Pose2
from tests.support.mutations.wires import HERE
from tests.support.runtime.recorded_values import make_estimate
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

DOMAIN = 176
CLICK = np.diag((0.25, 0.16, 0.0, 0.0, 0.0, 0.0685))  # of RViz, narrower to one side


def message(frame: str = "map", yaw_rad: float = 1.0, covariance: Any = CLICK, x: float = 3.0) -> Any:
    turn = SimpleNamespace(x=0.0, y=0.0, z=np.sin(0.5 * yaw_rad), w=np.cos(0.5 * yaw_rad))
    pose = SimpleNamespace(position=SimpleNamespace(x=x, y=-2.0, z=0.0), orientation=turn)
    spread = np.asarray(covariance).ravel().tolist()
    return SimpleNamespace(header=SimpleNamespace(frame_id=frame), pose=SimpleNamespace(pose=pose, covariance=spread))


@pytest.mark.parametrize("frame", ["map", "/map", "r1/map", ""])
def test_a_click_says_where_the_rover_is_and_how_well_that_is_known(frame: str) -> None:
    told = parse_prior(words_of(message(frame), Frames("r1")))
    np.testing.assert_allclose(told.pose.as_array(), (3.0, -2.0, 1.0), atol=1e-8)
    np.testing.assert_allclose((told.sigma_m, told.sigma_rad), (0.5, 0.0685**0.5), atol=1e-8)
    assert rclpy_node.words_of(message(frame), "r1") == words_of(message(frame), Frames("r1"))
    by_default = parse_prior(words_of(message(frame, covariance=np.zeros(36)), Frames("r1")))
    assert by_default.sigma_m == parse_prior("0,0,0").sigma_m


@pytest.mark.parametrize("value", [0.0, 1.0, 1e200, -1e308, float("inf"), float("nan")])
def test_a_quaternion_that_is_no_rotation_is_refused_in_one_sentence(value: float) -> None:
    """1e200 ended the bridge; zeros were yaw 0, and (0, 0, 1, 1) was 135 degrees instead of 90."""
    odd = message()
    for axis in "xyzw":
        setattr(odd.pose.pose.orientation, axis, value)
    with pytest.raises(ValueError, match=r"has a quaternion whose length squared is .*, expected 1"):
        words_of(odd, Frames("r1"))
    with pytest.raises(ValueError, match=r"has a quaternion whose length squared is .*, expected 1"):
        rclpy_node.words_of(odd, "r1")


def test_of_a_flood_of_poses_one_a_second_is_told_to_the_rover() -> None:
    """The rover would search for each, and a terminal would show nothing else."""
    told: list[str] = []
    follower: Any = SimpleNamespace(command=lambda command, words, heard: told.append(words))
    bridge = Bridge({}, Frames("r1"))
    for number in range(3000):
        bridge.tell(message(x=float(number)), follower, number * 0.001)
    assert [words.split(",")[0] for words in told] == ["0", "1000", "2000"]
    said = [bridge.answers.get() for _ in range(bridge.answers.qsize())]
    assert said == ["a pose on /initialpose is ignored: it came within 1 s of another"] * 3


def test_a_message_that_ros_cannot_read_ends_no_node(capsys: pytest.CaptureFixture[str]) -> None:
    """There is no ROS here: that rclpy is missing stands for whatever it raises."""
    bridge = rclpy_node.Bridge.__new__(rclpy_node.Bridge)
    bridge.prefix, bridge.publishers, bridge.troubles = "r1", {}, set()
    for _ in range(3):
        bridge.send("pose", b"\x1b")
    assert capsys.readouterr().err.count("a pose that no rover sends is left out: ") == 1


@pytest.mark.parametrize(
    ("odd", "said"),
    [
        ({"frame": "odom"}, "in the frame 'odom', expected 'r1/map'"),
        ({"x": float("nan")}, "nan"),
        ({"x": 1e30}, "within"),
        ({"covariance": np.full(36, 1e9)}, "SIGMA_M"),
    ],
)
def test_what_makes_no_sense_is_one_sentence(odd: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        words_of(message(**odd), Frames("r1"))


def test_the_file_for_machines_with_ros_refuses_another_frame_as_well() -> None:
    with pytest.raises(ValueError, match="in the frame 'odom', expected 'r1/map'"):
        rclpy_node.words_of(message("odom"), "r1")


def answers(port: int) -> bool:
    try:
        return bool(find_rover(f"tcp/127.0.0.1:{port}", "r1"))
    except SensorError:
        return False


def test_a_rover_that_takes_no_commands_is_named_as_one() -> None:
    port, heard = free_port(), SimpleQueue[Answer]()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(3), 0.0)
        assert until(lambda: answers(port))
        with following(find_rover(f"tcp/127.0.0.1:{port}", "r1"), ()) as follower:
            follower.command(Command.INITIAL_POSE, "1,2,3", heard.put)
            assert until(lambda: not heard.empty())
    answer = heard.get()
    assert not answer.accepted
    assert "r1 does not answer infant/r1/command/initial_pose; is it running, is publish.commands on" in answer.reason
    assert heard.empty()


def test_a_pose_written_in_dds_arrives_at_the_rover_and_its_answer_is_told(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    from runtime.bridge.dds import RawWriter, idl_type

    rule, port, stop, said = tmp_path / "here.json5", free_port(), threading.Event(), io.StringIO()
    rule.write_text(HERE)
    estimate = replace(make_estimate(0, np.random.default_rng(1)), map_from_body=Pose2(3.0, -2.0, 1.0))
    estimate = replace(estimate, covariance=np.diag((0.25, 0.16, 0.0685)))
    options = BridgeOptions(connect=f"tcp/127.0.0.1:{port}", rover="r1", domain=DOMAIN, resolution_m=None)
    with publishing(settings_on(port, commands=True, config_file=str(rule))) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(3), 0.0)
        assert until(lambda: answers(port))
        bridge = threading.Thread(target=bridge_ros2, args=(options, stop, said))
        bridge.start()
        assert until(lambda: "is in ROS 2 domain" in said.getvalue())  # it sets up the domain of this process
        node = DomainParticipant(DOMAIN)
        topic = Topic(node, "rt/r1/initialpose", idl_type(POSE))
        writer = RawWriter(DataWriter(node, topic, qos=Qos(Policy.Reliability.Reliable(duration(seconds=1)))))
        events: list[Any] = []

        def arrived() -> bool:
            writer.write(pose_bytes(1, estimate, Frames("r1")))
            events.extend(publisher.drain_events())
            return bool(events) and "the rover searches its map there" in said.getvalue()

        try:
            assert until(arrived), said.getvalue()
        finally:
            stop.set()
            bridge.join()
    assert command_of(events[0]) is Command.INITIAL_POSE
    told = parse_prior(events[0].reason)
    np.testing.assert_allclose(told.pose.as_array(), (3.0, -2.0, 1.0), atol=1e-6)
    np.testing.assert_allclose((told.sigma_m, told.sigma_rad), (0.5, 0.0685**0.5), atol=1e-6)
