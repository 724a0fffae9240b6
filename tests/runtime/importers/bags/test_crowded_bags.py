"""A bag of a few kilobytes that would be hours of work, gigabytes of memory or a file's worth of text is cut short."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from runtime.errors import DataSetError
from runtime.importers import rosbag
from runtime.importers.bags.mcap_records import mcap_records
from runtime.importers.data_set import import_data_set
from runtime.importers.parsing import inflation
from runtime.importers.parsing.inflation import Inflation
from tests.support.runtime.bags import ODOMETRY, SCAN, START_NS, TRANSFORMS, Made, Message, room_drive, write_mcap

ROS2 = Made(False)


def scans_at(*times_s: float) -> Iterator[Message]:
    for time_s in times_s:
        stamp_ns = round(1e9 * time_s)
        yield "/scan", SCAN, abs(stamp_ns), ROS2.scan(stamp_ns, [1.0, 2.0, 3.0], -0.1, 0.1)


def test_a_stamp_at_the_end_of_its_range_does_not_make_a_recording_of_a_century(tmp_path: Path) -> None:
    """531 bytes with stamps of 1902 and 2038 took 4.4 GB as wheels at rest."""
    source = write_mcap(tmp_path / "a.mcap", scans_at(-(2.0**31), 1e9, 1e9 + 0.1, 1e9 + 0.2, 2.0**31 - 1.0))
    result = import_data_set(source, tmp_path / "run", at_rest=True)
    assert result["scans"] == 3
    assert any(
        "2 of 5 scans left out: scan_t is a month or more from the others" in each for each in result["warnings"]
    )


def test_a_sensor_is_not_at_rest_for_weeks(tmp_path: Path) -> None:
    source = write_mcap(tmp_path / "a.mcap", scans_at(1e9, 1e9 + 1e6))
    with pytest.raises(DataSetError, match=r"scans span 1000000 s, expected at most 43200 s of a sensor at rest"):
        import_data_set(source, tmp_path / "run", at_rest=True)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("kind", [SCAN, ODOMETRY, TRANSFORMS])
def test_messages_that_fill_the_memory_are_read_up_to_there(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """300 000 scans of one beam, in 2.5 MB, took half a gigabyte."""

    made_of = {
        SCAN: lambda ns: ROS2.scan(ns, [1.0], 0.0, 0.1),
        ODOMETRY: lambda ns: ROS2.odometry(ns, 0.0, 0.0, 0.0),
        TRANSFORMS: lambda ns: ROS2.transforms(ns, ("odom", "base", (0.0, 0.0, 0.0), ROS2.turn(0.0))),
    }

    def made() -> Iterator[Message]:
        yield from room_drive(ROS2)
        for n in range(40):
            stamp_ns = START_NS + 4_000_000_000 + n
            content = made_of[kind](stamp_ns)
            yield {SCAN: "/scan", ODOMETRY: "/odom", TRANSFORMS: "/tf"}[kind], kind, stamp_ns, content

    source = write_mcap(tmp_path / "a.mcap", made())
    monkeypatch.setattr(rosbag, "KEPT_TIMES", 0)
    usual = 30 * (rosbag.SCAN_BYTES + 181 * rosbag.BEAM_BYTES + rosbag.POSE_BYTES)
    monkeypatch.setattr(rosbag, "KEPT_BYTES", usual + 10_000)
    result = import_data_set(source, tmp_path / "run")
    told = "a.mcap holds more than fits into memory and is read up to 1700000004.000 s"
    assert any(told in each for each in result["warnings"])
    assert 60 < result["scans"] + result["wheel_samples"] + 12 < 90


def test_a_message_of_a_megabyte_is_no_transform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosbag, "LARGEST_MESSAGE", 5000)

    def made() -> Iterator[Message]:
        yield from room_drive(ROS2)
        many = [(f"a{n}", f"b{n}", (0.0, 0.0, 0.0), ROS2.turn(0.0)) for n in range(100)]
        yield "/tf", TRANSFORMS, START_NS, ROS2.transforms(START_NS, *many)

    result = import_data_set(write_mcap(tmp_path / "a.mcap", made()), tmp_path / "run")
    assert any("the message has more than 5000 bytes" in each for each in result["warnings"])


def test_names_of_frames_are_short_and_printable(tmp_path: Path) -> None:
    def made() -> Iterator[Message]:
        for topic, kind, stamp_ns, content in room_drive(ROS2):
            if kind == SCAN:
                content.header.frame_id = "\x1b[2J" + "long" * 10_000
            yield topic, kind, stamp_ns, content

    result = import_data_set(write_mcap(tmp_path / "a.mcap", made()), tmp_path / "run")
    (note,) = (note for note in result["notes"] if "no transform leads" in note)
    assert note.isprintable()
    assert len(note) < 500


def test_records_that_pack_to_nothing_are_not_read_by_the_million(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inflation, "FREE_RECORDS", 100)
    source = write_mcap(tmp_path / "a.mcap", room_drive(ROS2, 300))
    with source.open("rb") as stream, pytest.raises(ValueError, match="packed into less than 2 bytes each"):
        for _ in mcap_records(stream, Inflation(20)):
            pass
