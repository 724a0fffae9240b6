"""Recordings of ROS become runs, whichever recorder wrote them and however it ended."""

import dataclasses
import math
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1

from drivers.measurements import OdometryPose, Scan
from runtime.errors import DataSetError
from runtime.importers.data_set import import_data_set
from runtime.importers.rosbag import Topics
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from tests.support.runtime.bags import (
    BEAMS,
    ODOMETRY,
    SCAN,
    START_NS,
    TRANSFORMS,
    Made,
    Message,
    room_drive,
    write_bag1,
    write_bag2,
    write_mcap,
)
from tests.support.runtime.carmen_logs import moments, room_ranges

ROS1, ROS2 = Made(True), Made(False)
WRITERS: dict[str, Callable[[Path], Path]] = {
    "ros1.bag": lambda path: write_bag1(path, room_drive(ROS1)),
    "sqlite": lambda path: write_bag2(path, room_drive(ROS2), "sqlite3"),
    "mcap": lambda path: write_bag2(path, room_drive(ROS2), "mcap"),
    "ros2.mcap": lambda path: write_mcap(path, room_drive(ROS2)),
    "ros1.mcap": lambda path: write_mcap(path, room_drive(ROS1), is_ros1=True),
}


def without(*kinds: str) -> Iterator[Message]:
    return (message for message in room_drive(ROS2) if message[1] not in kinds)


def recorded_scans(run: Path) -> list[Scan]:
    return [again.tick.scan for again in RunReader(run).ticks() if isinstance(again.tick.scan, Scan)]


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_bag_holds_the_same_drive(tmp_path: Path, kind: str) -> None:
    result = import_data_set(WRITERS[kind](tmp_path / kind), tmp_path / "run")
    assert (result["scans"], result["wheel_samples"], result["warnings"]) == (30, 30, [])
    assert result["mount"] == {"x_m": 0.2, "y_m": 0.0, "yaw_rad": 0.0, "upside_down": False}
    assert RunReader(tmp_path / "run").header.wall_minus_monotonic_ns == pytest.approx(START_NS, abs=1000)
    last = list(moments(30))[-1]
    scan = recorded_scans(tmp_path / "run")[-1]
    np.testing.assert_allclose(scan.ranges_m, room_ranges(last, BEAMS), rtol=1e-6)
    assert math.degrees(scan.bearings_rad[0]) == pytest.approx(-90.0)
    *_, tick = (again.tick for again in RunReader(tmp_path / "run").ticks() if again.tick.wheels)
    pose = tick.wheels[-1]
    assert isinstance(pose, OdometryPose)
    np.testing.assert_allclose((pose.x_m, pose.y_m, pose.heading_rad), last[1:], atol=1e-9)


def test_a_bag_is_replayed(tmp_path: Path) -> None:
    import_data_set(write_bag2(tmp_path / "bag", room_drive(ROS2, 60), "mcap"), tmp_path / "run")
    result = replay_run(tmp_path / "run", None, None, False, {})
    assert (result["scans"], result.get("defects", 0)) == (60, 0)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_folder_whose_recorder_was_killed_has_no_metadata(tmp_path: Path, storage: str) -> None:
    bag = write_bag2(tmp_path / "bag", room_drive(ROS2), storage)
    (bag / "metadata.yaml").unlink()
    assert import_data_set(bag, tmp_path / "run")["scans"] == 30


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_torn_file_is_read_as_far_as_it_goes_and_said(tmp_path: Path, share: float) -> None:
    whole = write_mcap(tmp_path / "whole.mcap", room_drive(ROS2), chunk_bytes=4000).read_bytes()
    data_end = whole.rfind(b"\x0f\x04\0\0\0\0\0\0\0")
    (tmp_path / "torn.mcap").write_bytes(whole[: round(share * data_end)])
    result = import_data_set(tmp_path / "torn.mcap", tmp_path / "run")
    assert share * 30 - 5 < result["scans"] < 30
    assert any("torn.mcap is read as far as possible" in warning for warning in result["warnings"])


@pytest.mark.parametrize("size", [13, 200, 3000])
def test_a_bag_of_ros_1_that_ends_before_its_messages_is_refused_in_one_sentence(tmp_path: Path, size: int) -> None:
    whole = WRITERS["ros1.bag"](tmp_path / "whole.bag").read_bytes()
    (tmp_path / "torn.bag").write_bytes(whole[:size])
    with pytest.raises(DataSetError, match="cannot be read as a bag") as caught:
        import_data_set(tmp_path / "torn.bag", tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("packed", [None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4])
@pytest.mark.parametrize("share", [0.6, 0.95])
def test_a_bag_of_ros_1_without_an_index_is_read_as_far_as_it_goes(
    tmp_path: Path, share: float, packed: Writer1.CompressionFormat | None
) -> None:
    whole = write_bag1(tmp_path / "whole.bag", room_drive(ROS1), packed, chunk_bytes=4000).read_bytes()
    (tmp_path / "torn.bag").write_bytes(whole[: round(share * len(whole))])
    result = import_data_set(tmp_path / "torn.bag", tmp_path / "run")
    assert share * 30 - 6 < result["scans"] <= 30
    assert result["mount"]["x_m"] == 0.2
    said = any("torn.bag is read as far as possible: " in warning for warning in result["warnings"])
    assert said or result["scans"] == 30  # cut between two records of the index, which nobody needs


@pytest.mark.parametrize("kind", ["ros2.mcap", "ros1.bag", "sqlite"])
def test_any_damage_is_a_run_or_one_sentence(tmp_path: Path, kind: str) -> None:
    whole = WRITERS[kind](tmp_path / kind)
    source = whole if whole.is_file() else next(whole.glob("*.db3"))
    content = source.read_bytes()
    rng = np.random.default_rng(7)
    for trial in range(40):
        damaged = bytearray(content)
        for place in rng.integers(8, len(content), 1 + trial % 5).tolist():
            damaged[place] ^= int(rng.integers(1, 256))
        source.write_bytes(damaged)
        run = tmp_path / f"run{trial}"
        try:
            assert import_data_set(whole, run)["scans"] > 0
        except DataSetError as error:
            assert "\n" not in str(error)  # noqa: PT017 either outcome will do
        shutil.rmtree(run, ignore_errors=True)


def test_topics_are_found_or_named(tmp_path: Path) -> None:
    def twice() -> Iterator[Message]:
        for topic, kind, stamp_ns, content in room_drive(ROS2):
            yield topic, kind, stamp_ns, content
            if kind == SCAN:
                yield "/scan_rear", kind, stamp_ns, content
            if kind == ODOMETRY:
                yield "/odometry/filtered", kind, stamp_ns, content

    bag = write_mcap(tmp_path / "a.mcap", twice())
    result = import_data_set(bag, tmp_path / "usual")
    assert "/scan is used; --scan-topic chooses another: /scan_rear" in result["notes"]
    named = Topics("/scan_rear", "/odometry/filtered")
    assert import_data_set(bag, tmp_path / "named", topics=named)["scans"] == 30
    with pytest.raises(
        DataSetError, match=r"no topic /scan_left .*--scan-topic.*/scan_rear \(sensor_msgs/msg/LaserScan\)"
    ):
        import_data_set(bag, tmp_path / "absent", topics=Topics("/scan_left"))


def test_several_topics_of_which_none_is_usual_must_be_named(tmp_path: Path) -> None:
    both = (("/left", *rest) for _, *rest in without(TRANSFORMS, ODOMETRY))
    bag = write_mcap(tmp_path / "a.mcap", (*both, *(("/right", *rest) for _, *rest in without(TRANSFORMS, ODOMETRY))))  # type: ignore[arg-type]
    with pytest.raises(
        DataSetError, match="2 topics of type sensor_msgs/msg/LaserScan: /left, /right; choose one with --scan-topic"
    ):
        import_data_set(bag, tmp_path / "run")


def test_a_bag_without_scans_lists_its_topics(tmp_path: Path) -> None:
    bag = write_mcap(tmp_path / "a.mcap", without(SCAN))
    with pytest.raises(DataSetError, match=r"no topic of type sensor_msgs/msg/LaserScan; its topics: /odom \(nav_msgs"):
        import_data_set(bag, tmp_path / "run")


def test_a_bag_without_odometry_says_what_to_do(tmp_path: Path) -> None:
    bag = write_mcap(tmp_path / "a.mcap", without(ODOMETRY))
    with pytest.raises(DataSetError, match="--at-rest"):
        import_data_set(bag, tmp_path / "run")
    assert import_data_set(bag, tmp_path / "run", at_rest=True)["scans"] == 30


def test_the_motion_of_tf_takes_the_place_of_odometry(tmp_path: Path) -> None:
    def moving() -> Iterator[Message]:
        yield from without(ODOMETRY)
        for t, x, y, heading in moments(30):
            stamp_ns = START_NS + round(t * 1e9)
            pair = ("odom", "base_link", (x, y, 0.0), ROS2.turn(heading))
            yield "/tf", TRANSFORMS, stamp_ns, ROS2.transforms(stamp_ns, pair)

    result = import_data_set(write_mcap(tmp_path / "a.mcap", moving()), tmp_path / "run")
    assert (result["wheel_samples"], result["mount"]["x_m"]) == (30, 0.2)
    assert any("the motion in /tf is used" in note for note in result["notes"])


def scans_of(
    tmp_path: Path, change: Callable[[int, Any], Any], mounted: Any = None
) -> tuple[list[Scan], dict[str, Any]]:
    def changed() -> Iterator[Message]:
        for number, (topic, kind, stamp_ns, content) in enumerate(room_drive(ROS2)):
            if kind == TRANSFORMS and mounted is not None:
                pair = ("base_link", "laser", (0.2, 0.0, 0.3), mounted)
                yield topic, kind, stamp_ns, ROS2.transforms(stamp_ns, pair)
            else:
                yield topic, kind, stamp_ns, change(number, content) if kind == SCAN else content

    result = import_data_set(write_mcap(tmp_path / "a.mcap", changed()), tmp_path / "run")
    return recorded_scans(tmp_path / "run"), result


def test_a_laser_that_hangs_upside_down_is_mounted_so(tmp_path: Path) -> None:
    scans, result = scans_of(tmp_path, lambda _, scan: scan, ROS2.turn(0.0, math.pi))
    assert result["mount"] == {"x_m": 0.2, "y_m": 0.0, "yaw_rad": 0.0, "upside_down": True}
    np.testing.assert_allclose(scans[0].ranges_m, room_ranges(next(moments(1)), BEAMS), rtol=1e-6)


def test_a_laser_that_looks_backwards_has_its_yaw(tmp_path: Path) -> None:
    _, result = scans_of(tmp_path, lambda _, scan: scan, ROS2.turn(math.pi))
    assert abs(result["mount"]["yaw_rad"]) == pytest.approx(math.pi)


def test_a_tilted_laser_is_named(tmp_path: Path) -> None:
    _, result = scans_of(tmp_path, lambda _, scan: scan, ROS2.turn(0.0, math.radians(30.0)))
    assert any("laser is tilted by 30 deg" in warning for warning in result["warnings"])


def test_a_laser_that_turns_unevenly_keeps_the_beams_of_each_scan(tmp_path: Path) -> None:
    def uneven(number: int, scan: Any) -> Any:
        kept = 100 + number
        return dataclasses.replace(scan, ranges=scan.ranges[:kept].copy(), angle_increment=0.01 + 1e-5 * number)

    scans, _ = scans_of(tmp_path, uneven)
    assert len({len(scan.ranges_m) for scan in scans}) == 30
    assert len({float(scan.bearings_rad[1] - scan.bearings_rad[0]) for scan in scans}) == 30


def test_what_a_scan_says_of_its_ranges_and_its_sweep_is_used(tmp_path: Path) -> None:
    def told(number: int, scan: Any) -> Any:
        ranges = scan.ranges.copy()
        ranges[:4] = (0.01, np.inf, np.nan, 31.0)
        return dataclasses.replace(scan, ranges=ranges, time_increment=0.05 / BEAMS)

    scans, _ = scans_of(tmp_path, told)
    assert np.isnan(scans[3].ranges_m[:4]).all()
    assert np.isfinite(scans[3].ranges_m[4:]).all()
    assert scans[3].beam_period_s == pytest.approx(0.05 / BEAMS)


def test_a_clockwise_sweep_keeps_the_time_of_each_beam(tmp_path: Path) -> None:
    def clockwise(number: int, scan: Any) -> Any:
        turned = dataclasses.replace(scan, ranges=scan.ranges[::-1].copy(), time_increment=0.05 / BEAMS)
        return dataclasses.replace(turned, angle_min=0.5 * math.pi, angle_increment=-math.pi / (BEAMS - 1))

    scans, _ = scans_of(tmp_path, clockwise)
    np.testing.assert_allclose(scans[0].ranges_m, room_ranges(next(moments(1)), BEAMS), rtol=1e-6)
    assert math.degrees(scans[0].bearings_rad[0]) == pytest.approx(-90.0)
    assert scans[0].stamp_beam == BEAMS - 1
    assert scans[0].beam_period_s == pytest.approx(-0.05 / BEAMS)


def test_a_scan_without_a_stamp_has_the_time_of_its_recording(tmp_path: Path) -> None:
    scans, _ = scans_of(tmp_path, lambda _, scan: dataclasses.replace(scan, header=ROS2.header(0, "laser")))
    assert [scan.stamp_ns for scan in scans[:3]] == pytest.approx([0, 100_000_000, 200_000_000], abs=1000)


def test_clocks_that_do_not_overlap_are_refused(tmp_path: Path) -> None:
    def simulated(number: int, scan: Any) -> Any:
        return dataclasses.replace(scan, header=ROS2.header(10_000_000_000 + number * 50_000_000, "laser"))

    with pytest.raises(DataSetError, match="they do not overlap, so both need stamps of one clock"):
        scans_of(tmp_path, simulated)


@pytest.mark.parametrize("has_metadata", [False, True])
def test_a_bag_whose_messages_are_a_view_without_end_is_refused(tmp_path: Path, has_metadata: bool) -> None:
    path = tmp_path / "bag" / "bag.db3"
    path.parent.mkdir()
    if has_metadata:
        (path.parent / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics (id, name, type); INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan');"
            "CREATE VIEW messages AS WITH RECURSIVE row (x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM row)"
            " SELECT 1 AS topic_id, x AS timestamp, x'00' AS data FROM row;"
        )
    with pytest.raises(DataSetError, match=r"two tables|no laser|no topic|LaserScan"):
        import_data_set(path.parent, tmp_path / "run")
