"""Real rclpy nodes of Jazzy and Kilted see a rover through the bridge, in both its forms: `make ros`."""

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from runtime.errors import SensorError
from runtime.messages.tick import decode
from runtime.publish.find_rover import find_rover
from runtime.publish.follow import following
from runtime.source_tree import ROOT
from tests.support.ros2.environments import environment_of, python312
from tests.support.zenoh.wire import free_port, until

pytestmark = pytest.mark.ros2
NODE = ROOT / "tests" / "support" / "ros2" / "listening_node.py"
FILE = ROOT / "runtime" / "bridge" / "rclpy_node.py"
TOPICS = {"scan", "pose", "odom", "map", "landmarks", "particles", "path", "/diagnostics"}
LISTEN_S = "12"
MEASURED_S = "64"
MEASURED_POSES = 600
DOMAIN = "177"
CLICK = "3,-2,0,0.5,0.25"


@pytest.fixture(scope="module", params=["jazzy", "kilted"])
def ros_python(request: pytest.FixtureRequest) -> Path:
    python = python312()
    if python is None:
        pytest.skip("no Python 3.12 is here, for which alone ROS 2 is in the package index")
    there, why = environment_of(request.param, python)
    if there is None:
        pytest.skip(f"ROS 2 {request.param} cannot be installed: {why}")
    return there


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A simulated rover that drives; its endpoint."""
    folder, endpoint = tmp_path_factory.mktemp("rover"), f"tcp/127.0.0.1:{free_port()}"
    text = (ROOT / "config" / "mock.toml").read_text()
    (folder / "rover.toml").write_text(f'{text}\n[publish]\nlisten = ["{endpoint}"]\nconnect = []\n')
    words = ("run", "--config", str(folder / "rover.toml"), "--duration", "900", "--out", str(folder / "run"))
    with started(sys.executable, "-m", "runtime.cli", *words):
        assert until(lambda: answers(endpoint), 300.0), "the rover does not come up"
        yield endpoint


def answers(endpoint: str) -> bool:
    try:
        return find_rover(endpoint, None).name == "mock"
    except SensorError:
        return False


@contextmanager
def started(*words: str, **environment: str) -> Iterator[Path]:
    """What it says goes into a file."""
    with tempfile.NamedTemporaryFile() as said:
        process = subprocess.Popen(words, cwd=ROOT, env=os.environ | environment, stdout=said, stderr=subprocess.STDOUT)
        try:
            yield Path(said.name)
            assert process.poll() is None, f"{words} ended by itself"
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(60)


def heard(ros_python: Path, seconds: str = LISTEN_S) -> dict[str, Any]:
    """What a node that comes late has received."""
    environment = os.environ | {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    node = [str(ros_python), str(NODE), "/mock", seconds]
    done = subprocess.run(node, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_a_real_node_that_comes_late_receives_every_topic_from_dds(rover: str, ros_python: Path) -> None:
    words = ("bridge", "ros2", "--connect", rover, "--domain", DOMAIN)
    with started(sys.executable, "-m", "runtime.cli", *words) as said:
        assert until(lambda: "map" in heard(ros_python)["found"]), "no map within two minutes"
        told, refused = heard(ros_python), said.read_text()
    assert told["found"].keys() >= TOPICS
    assert CLICK in refused
    assert "does not answer" in refused, "this rover takes no commands"
    assert told["found"]["scan"]["frame"] == "mock/laser"
    assert told["found"]["odom"]["child"] == "mock/base_link"
    assert told["found"]["odom"]["covariance"] >= 0.0
    assert told["topics"]["/tf"] == told["topics"]["/tf_static"] == ["tf2_msgs/msg/TFMessage"]


@contextmanager
def ages_over_zenoh(endpoint: str) -> Iterator[dict[int, float]]:
    """Stamp in ns and age in ms of each pose, as a subscriber of the rover itself has them; grows meanwhile."""
    ages_ms: dict[int, float] = {}
    stop = threading.Event()

    def listen() -> None:
        with following(find_rover(endpoint, None), ("pose",), None) as follower:
            while not stop.is_set():
                message = follower.next(0.1)
                if message is not None:
                    stamp = decode("/pose", message.data).header.stamp
                    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
                    ages_ms[stamp_ns] = (time.time_ns() - stamp_ns) * 1e-6

    thread = threading.Thread(target=listen)
    thread.start()
    try:
        yield ages_ms
    finally:
        stop.set()
        thread.join()


def test_a_real_node_loses_no_pose_and_has_it_hardly_later_than_over_zenoh(rover: str, ros_python: Path) -> None:
    words = ("bridge", "ros2", "--connect", rover, "--domain", DOMAIN)
    with started(sys.executable, "-m", "runtime.cli", *words), ages_over_zenoh(rover) as direct_ms:
        assert until(lambda: "pose" in heard(ros_python)["found"]), "no pose within two minutes"
        node_ms = dict(heard(ros_python, MEASURED_S)["poses"])
    sent = [stamp_ns for stamp_ns in direct_ms if min(node_ms) <= stamp_ns <= max(node_ms)]
    lost = [stamp_ns for stamp_ns in sent if stamp_ns not in node_ms]
    later_ms = [node_ms[stamp_ns] - direct_ms[stamp_ns] for stamp_ns in sent if stamp_ns in node_ms]
    print(  # noqa: T201
        f"\n{ros_python.parts[-3]}: {len(lost)} of {len(sent)} poses lost; at the node's callback they are "
        f"{statistics.median(later_ms):+.2f} ms later than at a zenoh subscriber's (median; must be below +3 ms)"
    )
    assert len(sent) >= MEASURED_POSES
    assert not lost, f"lost are numbers {[sent.index(stamp_ns) for stamp_ns in lost]} of {len(sent)}"


def test_a_real_node_receives_the_same_from_the_file_for_machines_with_ros(rover: str, ros_python: Path) -> None:
    environment = {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "PYTHONPATH": ""}
    words = ("--rover", "mock", "--connect", rover, "--frame-prefix", "")
    with started(str(ros_python), str(FILE), *words, **environment) as said:
        assert until(lambda: "path" in heard(ros_python)["found"]), "nothing within two minutes"
        told, refused = heard(ros_python), said.read_text()
    assert f"{CLICK}: refused: mock does not answer" in refused, "this rover takes no commands"
    assert told["found"].keys() >= TOPICS - {"map"}  # the map is `infant map live`'s
    assert told["found"]["scan"]["frame"] == "laser"
