"""What `infant export` writes is read by programs that nobody here wrote, and stands in one tree of frames."""

import csv
import json
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from runtime.errors import RunExistsError, UsageError
from runtime.export import grid
from runtime.export.export import Outputs, export_lines, export_run
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile, RunWriter
from slam.maps.occupancy_grid import OccupancyGrid
from slam.pose import Pose2
from tests.support.runtime.drawn_drive import MOUNT, YARD_M, drive

TICKS = 60
WALL_NS = 1_700_000_000_000_000_000
CONFIGURATION = f"[slam.mount]\nx_m = {MOUNT.x_m}\n"
TOPICS = {"/scan", "/odom", "/pose", "/tf", "/tf_static", "/map", "/path", "/landmarks", "/truth", "/particles"}
Messages = dict[str, list[tuple[int, Any]]]


def no_progress(_fraction: float) -> None:
    pass


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two segments."""
    folder = tmp_path_factory.mktemp("run")
    header = RunHeader(CONFIGURATION, "live", wall_minus_monotonic_ns=WALL_NS)
    records = list(drive(TICKS))
    for number, (name, part) in enumerate((("run-0001.mcap", records[:30]), ("run.mcap", records[30:])), start=1):
        writer = RunWriter(folder / name, header.metadata | {"segment": {"number": str(number)}})
        for each in part:
            writer.add(each)
        writer.close()
    return folder


@pytest.fixture(scope="module")
def bag(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags") / "drive's bag"
    summary = export_run(run, Outputs(ros2=folder), no_progress)
    assert summary["ticks"] == TICKS
    assert summary["stamps"] == "UTC"
    return folder


@pytest.fixture(scope="module")
def messages(bag: Path) -> Messages:
    found: Messages = {}
    with AnyReader([bag]) as reader:
        for connection, stamp_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((stamp_ns, reader.deserialize(data, connection.msgtype)))
    return found


def test_a_reader_of_others_finds_every_topic_with_as_many_messages_as_the_metadata_say(
    bag: Path, messages: Messages
) -> None:
    assert messages.keys() >= TOPICS
    with Reader(bag) as reader:
        assert reader.message_count == sum(len(each) for each in messages.values())
        assert {each.topic: each.msgcount for each in reader.connections} == {
            topic: len(each) for topic, each in messages.items()
        }
        durable = {each.topic for each in reader.connections if each.ext.offered_qos_profiles[0].durability.value == 1}  # type: ignore[union-attr]
    assert durable == {"/map", "/tf_static"}
    assert len(messages["/pose"]) == TICKS


def test_stamps_are_wall_time_and_those_of_both_segments_follow_each_other(messages: Messages) -> None:
    stamps = [stamp_of(message) for _, message in messages["/pose"]]
    assert stamps[0] == WALL_NS + 5_000_000_000
    assert set(np.diff(stamps)) == {100_000_000}
    came = [stamp_ns for stamp_ns, _ in messages["/scan"]]
    assert came == sorted(came)
    assert all(stamp_of(message) < stamp_ns for stamp_ns, message in messages["/scan"])


def test_the_scan_stands_in_the_map(messages: Messages) -> None:
    """Every end of a beam of the walls lies on the walls of the yard, through TF alone, and the grid agrees."""
    tree: dict[int, Pose2] = {}
    for _, message in messages["/tf"]:
        links = {(each.header.frame_id, each.child_frame_id): each for each in message.transforms}
        if ("map", "odom") in links:
            tree[stamp_of(message.transforms[0])] = planar(links["map", "odom"]) @ planar(links["odom", "base_link"])
    (static,) = messages["/tf_static"][0][1].transforms
    stamp_ns, scan = messages["/scan"][40]
    map_from_laser = tree[stamp_ns] @ planar(static)
    ends = np.isfinite(scan.ranges)
    bearings = scan.angle_min + scan.angle_increment * np.arange(scan.ranges.size)
    points = scan.ranges[:, None] * np.stack((np.cos(bearings), np.sin(bearings)), -1)
    outermost = np.abs(map_from_laser.transform(points[ends])).max(axis=1)
    assert np.mean(np.abs(outermost - YARD_M) < 0.2) > 0.7
    grid = messages["/map"][0][1]
    rows, columns = np.nonzero(grid.data.reshape(grid.info.height, grid.info.width) == 100)
    cells = np.column_stack((columns, rows)) * grid.info.resolution
    cells += (grid.info.origin.position.x, grid.info.origin.position.y)
    assert np.mean(np.abs(np.abs(cells).max(axis=1) - YARD_M) < 0.3) > 0.7
    assert messages["/map"][0][0] <= messages["/pose"][0][0], "a player has the map from its start"


def test_truth_is_a_frame_of_its_own(messages: Messages) -> None:
    children = {each.child_frame_id for _, message in messages["/tf"] for each in message.transforms}
    assert children == {"odom", "base_link", "truth"}
    assert messages["/truth"][0][1].header.frame_id == "map"


def test_tables_tell_every_tick_to_the_nanosecond(run: Path, tmp_path: Path) -> None:
    outputs = Outputs(csv=tmp_path / "a.csv", tum=tmp_path / "a.tum", geojson=tmp_path / "a.geojson")
    summary = export_run(run, outputs, no_progress)
    with (tmp_path / "a.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == TICKS
    assert rows[0]["stamp_s"] == "1700000005.000000000"
    tum = [line.split() for line in (tmp_path / "a.tum").read_text().splitlines()]
    assert [row["x_m"] for row in rows] == [words[1] for words in tum]
    heading_rad = 2.0 * np.arctan2(float(tum[-1][6]), float(tum[-1][7]))
    assert heading_rad == pytest.approx(float(rows[-1]["heading_rad"]), abs=1e-5)
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert features[0]["geometry"]["type"] == "LineString"
    assert {each["geometry"]["type"] for each in features[1:]} == {"Point"}
    assert any("a.csv" in line for line in export_lines(summary))


def test_what_cannot_be_exported_is_told_in_one_sentence(run: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nothing to write"):
        export_run(run, Outputs(), no_progress)
    (tmp_path / "there").write_text("")
    with pytest.raises(RunExistsError, match="nothing is overwritten"):
        export_run(run, Outputs(tum=tmp_path / "there"), no_progress)
    empty = RunWriter(tmp_path / "run.mcap", RunHeader(CONFIGURATION, "live").metadata)
    empty.close()
    with pytest.raises(UsageError, match="holds no estimates"):
        export_run(tmp_path, Outputs(ros2=tmp_path / "bag", tum=tmp_path / "none.tum"), no_progress)
    assert not (tmp_path / "bag").exists()
    assert not (tmp_path / "none.tum").exists()


def test_nothing_goes_where_a_link_points_nor_is_an_empty_folder_taken_for_a_file(run: Path, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    for outputs in (Outputs(ros2=tmp_path / "link"), Outputs(csv=tmp_path / "link"), Outputs(csv=tmp_path / "folder")):
        with pytest.raises(RunExistsError, match="nothing is overwritten"):
            export_run(run, outputs, no_progress)
    assert not any((tmp_path / "folder").iterdir())


def test_a_run_that_is_being_recorded_is_left_alone(run: Path, tmp_path: Path) -> None:
    shutil.copy(run / "run-0001.mcap", tmp_path)
    recording = RecordFile(tmp_path / "run.mcap", RunHeader(CONFIGURATION, "live").metadata)
    try:
        with pytest.raises(UsageError, match="still being recorded"):
            export_run(tmp_path, Outputs(csv=tmp_path / "a.csv"), no_progress)
    finally:
        recording.close()
    assert not (tmp_path / "a.csv").exists()


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def planar(transform: Any) -> Pose2:
    at, turn = transform.transform.translation, transform.transform.rotation
    return Pose2(at.x, at.y, 2.0 * np.arctan2(turn.z, turn.w))


def test_a_map_that_would_become_too_large_is_given_up_and_the_summary_says_so(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid, "MOST_CELLS", 1000)
    summary = export_run(run, Outputs(ros2=tmp_path / "bag"), no_progress)
    assert summary["part_of_map"]
    assert any("give a coarser --resolution" in line for line in export_lines(summary))


def test_a_growing_grid_of_the_largest_size_leaves_room_below_the_500_mb_of_an_export() -> None:
    side_m = 0.1 * np.sqrt(grid.MOST_CELLS) - 41.0  # the grid keeps a margin
    growing = OccupancyGrid(0.1, grid.MOST_CELLS)
    tracemalloc.start()
    for reach_m in (0.95 * side_m, side_m):
        growing._cover(np.zeros(2, np.int64), np.full(2, round(reach_m * 10.0), np.int64))
    peak_mb = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    assert 100.0 < peak_mb < 250.0  # the rest of the program takes 190
