"""What a run says is read by software that nobody here wrote: mcap, mcap_ros2, rerun's own loader, zenoh-ros2-sdk.

What rosbag2 asks of a file stands in its rosbag2_storage_mcap/src/mcap_storage.cpp; it is checked point by point.
"""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from drivers.canbus.frame import FD
from runtime.messages.definitions import TYPES
from runtime.messages.records import tick_records
from runtime.messages.ros import encode_can_frame
from runtime.messages.tick import Gap, LaserBytes, encode_gap, encode_laser_bytes
from runtime.publish import ros2_keys
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.review.viewer import headless_viewer, reported_errors, viewer_path
from runtime.review.writer import ReviewWriter
from runtime.settings.review import ReviewSettings
from runtime.source_tree import ROOT
from runtime.tick import CompletedTick
from slam.pose import Pose2
from tests.support.runtime.drawn_drive import MOUNT, drive
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing
from tests.support.zenoh.wire import free_port, publishing, put_ticks, settings_on, start_module, until

KNOWN_HASHES = {  # as `ros2 topic info --verbose` prints them on Jazzy
    "geometry_msgs/msg/PoseWithCovarianceStamped": "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "sensor_msgs/msg/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
}
EXPECTED_ENTITIES = {
    *(f"/map/{name}" for name in ("rover", "truth", "particles", "landmarks", "pose_covariance")),
    *(f"/map/laser/{name}" for name in ("kept", "rejected", "not_compared", "trace")),
    *(f"/map/association/{name}" for name in ("matched", "new_and_refused")),
    *(f"/map/path/{name}" for name in ("SLAM", "odometry", "truth")),
    *(f"/plots/timing/{name}_ms" for name in ("lateness", "read", "step")),
    *(f"/plots/sensors/{name}_age_ms" for name in ("laser", "wheels")),
    *(f"/plots/innovation_{name}/{of}" for name in ("range_m", "bearing_deg") for of in ("mean", "RMS")),
    *("/plots/filter/effective_particles", "/plots/map/landmarks", "/plots/error/SLAM_m", "/events", "/legend"),
}
ROS2_TYPES = tuple(KNOWN_HASHES)[:3]
TICKS = 20


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run.mcap with messages on every topic that a run can have."""
    path, rng = tmp_path_factory.mktemp("run") / "run.mcap", np.random.default_rng(4)
    writer = RunWriter(path, RunHeader("", "live").metadata)
    for seq in range(TICKS):
        tick = make_tick(seq + 1, rng, "sightings" if seq == 3 else "scan")
        estimate = make_estimate(tick.stamp_ns, rng)
        truth, defect = Pose2(0.1 * seq, 0.0, 0.0), "IndexError: no beam" if seq == 5 else ""
        records = tick_records(CompletedTick(tick, estimate, make_timing(seq), bytes(16), truth, defect))
        raw = [
            encode_laser_bytes(LaserBytes(tick.stamp_ns, seq % 2 == 0, b"GE\n")),
            encode_can_frame(tick.stamp_ns, 0x123, 0, b"\x01\x02"),
            encode_can_frame(tick.stamp_ns, 0x124, FD, bytes(12)),
        ]
        writer.add([*raw, *records])
    writer.add([encode_gap(Gap(10**10, 1, 2, "the disk was full"))])
    writer.close()
    return path


def decoded(path: Path) -> dict[str, list[Any]]:
    messages: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        for _, channel, _, message in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(channel.topic, []).append(message)
    return messages


def test_every_topic_is_decoded_out_of_the_definitions_in_the_file(mcap: Path) -> None:
    messages = decoded(mcap)
    assert set(messages) == set(TYPES)
    rng = np.random.default_rng(4)
    first = make_tick(1, rng)
    estimate = make_estimate(first.stamp_ns, rng)
    assert messages["/pose"][0].pose.pose.position.x == estimate.map_from_body.x_m
    assert messages["/pose"][0].header.frame_id == "map"
    np.testing.assert_array_equal(np.array(messages["/scan"][0].ranges, np.float32), first.scan.ranges_m)  # type: ignore[union-attr]
    assert list(messages["/estimate"][0].landmark_identities) == estimate.landmarks.identities.tolist()  # type: ignore[union-attr]
    assert messages["/gap"][0].reason == "the disk was full"
    assert [message.reason for message in messages["/defect"]] == ["IndexError: no beam"]
    assert messages["/raw/can"][0].id == 0x123
    assert len(messages["/odom"]) == TICKS


def test_the_file_has_what_rosbag2_asks_of_one_without_metadata_yaml(mcap: Path) -> None:
    with mcap.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert summary is not None
    statistics = summary.statistics
    assert statistics is not None, "read_metadata() takes duration and counts from here"
    assert 0 < statistics.message_start_time < statistics.message_end_time
    assert all(index.message_index_length > 0 for index in summary.chunk_indexes), "needed to play in order of time"
    counted = sum(statistics.channel_message_counts.values())
    assert counted == statistics.message_count > 0
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert channel.message_encoding == "cdr"
        assert schema.encoding == "ros2msg"
        assert re.fullmatch(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*", schema.name)
        assert re.fullmatch(r"(/[a-z][a-z0-9_]*)+", channel.topic)
        assert schema.data
        # without it rosbag2 plays with its default, reliable and volatile, which every subscriber can match;
        # with it each release of rosbag2 would want its own spelling
        assert "offered_qos_profiles" not in channel.metadata


def test_rerun_finds_nothing_wrong_with_the_file_and_loads_every_topic(mcap: Path, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    command = [viewer_path(), "mcap", "check", "--full", str(mcap)]
    checked = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = [line.split() for line in checked.stdout.splitlines() if " /" in line]
    assert len(rows) == len(TYPES)
    assert {row[0] for row in rows} == {"ok"}, checked.stdout
    rrd = tmp_path / "run.rrd"
    subprocess.run([viewer_path(), "mcap", "convert", "-o", rrd, mcap], check=True, capture_output=True)
    loaded = {str(chunk.entity_path) for chunk in RrdReader(rrd).stream()}
    assert set(TYPES) <= loaded


@pytest.mark.browser
def test_the_viewer_opens_the_record_itself_without_an_error(mcap: Path) -> None:
    with headless_viewer([mcap], (1000, 700), timeline="message_log_time") as client:
        state = client.get_state()
    assert state.recordings
    assert reported_errors(state) == []


def test_the_review_is_read_by_the_query_interface_that_rerun_gives_to_everyone(tmp_path: Path) -> None:
    pytest.importorskip("datafusion", reason="rerun-sdk[catalog] is not installed; make test installs it")
    from rerun.server import Server

    path, ticks = tmp_path / "review.rrd", 30
    writer = ReviewWriter(path, ReviewSettings(), MOUNT)
    for record in (record for tick in drive(ticks) for record in tick):
        writer.feed(record)
    writer.close()
    with Server(host="127.0.0.1", datasets={"run": [path]}) as server:
        review = server.client().get_dataset("run")
        entities = {column.entity_path for column in review.schema().component_columns()}
        table = review.filter_contents(["/map/rover", "/plots/**"]).reader(index="tick").to_arrow_table()
    assert entities >= EXPECTED_ENTITIES, sorted(EXPECTED_ENTITIES - entities)
    assert table["tick"].to_pylist() == list(range(ticks))
    assert table["/map/rover:Transform3D:translation"].null_count == 0


@pytest.mark.parametrize("type_name", list(KNOWN_HASHES))
def test_the_hash_of_a_type_is_the_one_that_ros2_prints(type_name: str) -> None:
    assert ros2_keys.type_hash(type_name) == f"RIHS01_{KNOWN_HASHES[type_name]}"


@pytest.mark.parametrize("type_name", [*KNOWN_HASHES, "diagnostic_msgs/msg/DiagnosticArray", "can_msgs/msg/Frame"])
def test_a_kit_that_nobody_here_wrote_computes_the_same_hash(type_name: str) -> None:
    pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed; make test installs it")
    from tests.support.zenoh.ros2_node import kit_hash

    assert kit_hash(type_name) == ros2_keys.type_hash(type_name)


def test_a_ros2_node_of_that_kit_hears_pose_odometry_and_tf_through_its_router() -> None:
    pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed; make test installs it")
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    router = start_module("tests.support.zenoh.router", endpoint)
    frames = {"/r1/pose": "map", "/r1/odom": "odom", "/tf": "map"}
    command = [sys.executable, "-m", "tests.support.zenoh.ros2_node", str(port)]
    try:
        with publishing(settings_on(free_port(), connect=(endpoint,), ros2=True)) as publisher:
            nodes = {
                topic: subprocess.Popen([*command, topic, name, "240"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
                for topic, name in zip(frames, ROS2_TYPES, strict=True)
            }

            def all_have_ended() -> bool:
                put_ticks(publisher, range(1), 0.0)
                return all(node.poll() is not None for node in nodes.values())

            assert until(all_have_ended)
        heard = {topic: json.loads(node.communicate()[0]) for topic, node in nodes.items()}
    finally:
        router.kill()
        router.wait()
    assert {topic: message.get("frame") for topic, message in heard.items()} == frames
    assert {message["stamp_s"] for message in heard.values()} == {1_700_000_000}
