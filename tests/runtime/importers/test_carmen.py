"""CARMEN logs of every kind that people have: what can be read is imported, what cannot is counted and said."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import Scan
from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.carmen import load_carmen
from runtime.importers.data_set import import_data_set
from runtime.importers.parsing import text_lines
from runtime.importers.sightings import seen
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.record.reader import RunReader
from tests.support.runtime.carmen_logs import (
    flaser,
    imported,
    moments,
    odom,
    robotlaser,
    room_log,
    room_ranges,
    written,
)


def carmen_line(t: float, ranges: list[float], laser: tuple[float, ...], robot: tuple[float, ...]) -> str:
    words = [len(ranges), *ranges, *laser, *robot, t, "host", t]
    return "FLASER " + " ".join(map(str, words)) + "\n"


CARMEN = "# a comment\nPARAM robot_length 0.5\n" + "".join(
    f"ODOM {0.1 * k} 0 0 0.5 0 0 {10 + 0.2 * k} host {10 + 0.2 * k}\n"
    + (carmen_line(10.1 + 0.2 * k, [1.0, 2.0, 81.9, 3.0], (0.11 * k, 0, 0), (0.1 * k, 0, 0)) if k % 3 == 0 else "")
    for k in range(10)
)


def test_a_carmen_log_is_imported(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(CARMEN)
    summary = import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert (summary["scans"], summary["wheel_samples"]) == (4, 14)
    scan = next(again.tick.scan for again in RunReader(tmp_path / "run").ticks() if again.tick.scan)
    assert isinstance(scan, Scan)
    np.testing.assert_array_equal(scan.ranges_m, np.array([1.0, 2.0, np.nan, 3.0], np.float32))
    assert scan.bearings_rad[0] == -0.5 * math.pi
    assert scan.bearings_rad[1] - scan.bearings_rad[0] == pytest.approx(math.pi / 4)
    assert summary["truth"] is not None  # the laser moves away from the robot: a correction and no mount


def test_a_compressed_log_with_a_constant_mount_has_no_truth(tmp_path: Path) -> None:
    lines = [carmen_line(t, [1.0] * 5, (t + 0.2, 0, 0), (t, 0, 0)) for t in (1.0, 2.0, 3.0)]
    (tmp_path / "a.log.gz").write_bytes(gzip.compress("".join(lines).encode(), mtime=0))
    archive = load_carmen(tmp_path / "a.log.gz")
    assert truth_of(archive) is None
    assert len(wheel_samples(archive)) == 3  # the scans' own odometry, as the log has no other


def test_the_other_laser_line_of_carmen_is_read(tmp_path: Path) -> None:
    robot = "ROBOTLASER1 0 -1.5 3.0 1.0 30.0 0.01 0 4 1 2 30 4 0 0.3 0 0 0.1 0 0 0 0 0 0 0 5.0 host 5.0\n"
    (tmp_path / "a.clf").write_text(robot)
    archive = load_carmen(tmp_path / "a.clf")
    scan = next(iter(seen(archive)))
    assert np.isnan(scan.ranges_m).tolist() == [False, False, True, False]
    np.testing.assert_allclose(scan.bearings_rad, [-1.5, -0.5, 0.5, 1.5])
    assert archive["scan_odom_pose"].tolist() == [[0.1, 0.0, 0.0]]


def first_scan(archive: Archive) -> Scan:
    scan = next(iter(seen(archive)))
    assert isinstance(scan, Scan)
    return scan


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ODOM 0 0 0 0 0 0 1 host 1\n", "holds no usable scan"),
        ("FLASER 3 1 2\n", r"a\.log:1: FLASER line cannot be read"),
        ("FLASER three 1 2\n", r"a\.log:1: FLASER line cannot be read"),
        ("ODOM 0 zero 0 0 0 0 1 host 1\n", r"a\.log:1: ODOM line"),
        ("FLASER 2 1 1 0 0 0 0 0 0 nan host nan\n", r"a\.log:1: FLASER line cannot be read \(nan is not a number\)"),
        ("PARAM robot_frontlaser_offset 300 0 host 0\n" + flaser((0.0, 0, 0, 0)) + "\n", "expected metres"),
    ],
)
def test_a_log_without_a_scan_is_refused_with_the_line_that_failed(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.log").write_text(text)
    with pytest.raises(DataSetError, match=said) as caught:
        import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_laser_that_was_not_connected_is_passed_over_and_counted(tmp_path: Path) -> None:
    lines = room_log(30)
    result = imported(tmp_path, [*lines[:20], "FLASER 0 0 0 0 0 0 0 1000000002.0 host 1000000002.0", *lines[20:]])
    assert result["scans"] == 30
    assert result["warnings"] == [
        "1 of 31 scans left out: FLASER line cannot be read (it has 0 beams) (first: a.log:21)"
    ]


def test_little_that_is_left_out_is_a_note_and_no_warning(tmp_path: Path) -> None:
    lines = room_log(150)
    result = imported(tmp_path, [*lines, "FLASER 0"])
    assert result["warnings"] == []
    assert [note for note in result["notes"] if note.startswith("1 of 151 scans left out")]


@pytest.mark.parametrize(
    ("beams", "last_deg"), [(1, 0.0), (2, 0.0), (180, 89.0), (181, 90.0), (360, 89.5), (361, 90.0)]
)
def test_any_number_of_beams_is_spread_as_a_sick_does(tmp_path: Path, beams: int, last_deg: float) -> None:
    (tmp_path / "a.log").write_text("\n".join(flaser(moment, [2.0] * beams) for moment in moments(3)) + "\n")
    scan = first_scan(load_carmen(tmp_path / "a.log"))
    assert scan.ranges_m.shape == (beams,)
    assert math.degrees(scan.bearings_rad[-1]) == pytest.approx(last_deg, abs=1e-6)


def test_scans_of_180_and_181_beams_in_one_log_keep_their_own_bearings(tmp_path: Path) -> None:
    lines = [flaser(moment, room_ranges(moment, 180 + k % 2)) for k, moment in enumerate(moments(6))]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    scans = list(seen(load_carmen(tmp_path / "a.log")))
    assert [len(scan.ranges_m) for scan in scans] == [180, 181] * 3
    assert np.isfinite(scans[1].ranges_m).sum() > 170


@pytest.mark.parametrize(
    ("told", "beams"),
    [
        (["laser_front_laser_fov 4.712389"], 1081),
        (["laser_front_laser_fov 270.0"], 1081),
        (["laser_front_laser_fov 270", "laser_front_laser_resolution 0.25"], 1080),
        (["laser_front_laser_resolution 0.5"], 541),
    ],
)
def test_the_field_of_view_that_the_log_tells_is_used(tmp_path: Path, told: list[str], beams: int) -> None:
    head = [f"PARAM {line} 0 host 0" for line in told]
    lines = [flaser(moment, [2.0] * beams) for moment in moments(2)]
    (tmp_path / "a.log").write_text("\n".join([*head, *lines]) + "\n")
    archive = load_carmen(tmp_path / "a.log")
    assert math.degrees(archive.meta["angle_min"]) == pytest.approx(-135.0, abs=0.3)
    assert math.degrees(archive.meta["angle_increment"]) == pytest.approx(0.5 if beams == 541 else 0.25, rel=1e-4)
    assert archive.left_out.warnings == []


def test_a_wide_laser_whose_field_of_view_nobody_tells_is_named(tmp_path: Path) -> None:
    result = imported(tmp_path, [flaser(moment, [2.0] * 1081) for moment in moments(20)])
    assert "laser_front_laser_fov" in result["warnings"][0]


def test_clockwise_beams_are_the_same_scan(tmp_path: Path) -> None:
    step = math.radians(1.0)
    turned = {"left.log": False, "right.log": True}
    scans = {}
    for name, clockwise in turned.items():
        lines = [
            robotlaser(m, 0.5 * math.pi, -step, room_ranges(m)[::-1])
            if clockwise
            else robotlaser(m, -0.5 * math.pi, step, room_ranges(m))
            for m in moments(3)
        ]
        (tmp_path / name).write_text("\n".join(lines) + "\n")
        scans[name] = list(seen(load_carmen(tmp_path / name)))
    for left, right in zip(*scans.values(), strict=True):
        np.testing.assert_array_equal(left.ranges_m, right.ranges_m)
        np.testing.assert_allclose(left.bearings_rad, right.bearings_rad, atol=1e-4)


def test_a_torn_last_line_loses_only_that_line(tmp_path: Path) -> None:
    lines = room_log(30)
    (tmp_path / "a.log").write_text("\n".join(lines)[:-500])
    result = import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert result["scans"] == 29
    assert any("the log was cut off in this line" in warning for warning in result["warnings"])


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_a_part_of_a_compressed_log_is_read_to_its_last_whole_line(tmp_path: Path, share: float) -> None:
    packed = gzip.compress("\n".join(room_log(60)).encode(), mtime=0)
    (tmp_path / "a.log.gz").write_bytes(packed[: round(share * len(packed))])
    result = import_data_set(tmp_path / "a.log.gz", tmp_path / "run")
    assert share * 60 - 6 < result["scans"] < 60
    assert any("last complete line: the compressed file ends early" in warning for warning in result["warnings"])


def test_a_comment_in_latin_1_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_bytes(b"# Aufnahme im B\xfcro\n" + "\n".join(room_log(30)).encode() + b"\n")
    result = import_data_set(tmp_path / "a.log", tmp_path / "run")
    assert (result["scans"], result["warnings"]) == (30, [])


def test_a_scan_without_a_time_is_left_out_with_its_line(tmp_path: Path) -> None:
    lines = room_log(30)
    lines[41] = lines[41].rsplit(" ", 1)[0] + " nan"
    result = imported(tmp_path, lines)
    assert result["scans"] == 29
    assert "nan is not a number) (first: a.log:42)" in result["warnings"][0]


@pytest.mark.parametrize("step_s", [-3600.0, -5.0, 200_000.0])
def test_a_clock_that_was_set_during_the_drive_loses_nothing_and_is_said(tmp_path: Path, step_s: float) -> None:
    starts = [1e9 + (step_s if k >= 20 else 0.0) for k in range(60)]
    lines = [
        line
        for start_s, moment in zip(starts, moments(60), strict=True)
        for line in (odom(moment, start_s), flaser(moment, start_s=start_s))
    ]
    result = imported(tmp_path, lines)
    assert (result["scans"], result["wheel_samples"]) == (60, 60)
    assert result["duration_s"] == pytest.approx(5.9, abs=0.01)
    (warning,) = result["warnings"]
    assert warning.startswith("a.log:41: the clock of the log was set")


def test_one_stamp_that_lies_far_away_is_left_out_alone(tmp_path: Path) -> None:
    lines = room_log(30)
    lines[30] = odom(list(moments(30))[15], start_s=1e9 - 5000.0)
    result = imported(tmp_path, lines)
    assert (result["scans"], result["wheel_samples"]) == (30, 30)  # the scan's own odometry stands for it
    assert "its neighbours" in result["warnings"][0]


def test_the_mount_that_a_log_shows_is_used(tmp_path: Path) -> None:
    result = imported(tmp_path, [flaser(moment, ahead_m=0.25) for moment in moments(20)])
    assert result["mount"] == {"x_m": 0.25, "y_m": 0.0, "yaw_rad": 0.0, "upside_down": False}
    assert result["truth"] is None


def test_the_mount_that_a_param_tells_is_used(tmp_path: Path) -> None:
    result = imported(tmp_path, ["PARAM robot_frontlaser_offset -0.04 0 host 0", *room_log(20)])
    assert result["mount"]["x_m"] == -0.04
    assert any(note.startswith("slam.mount.x_m = -0.04 is taken") for note in result["notes"])


def renamed(lines: list[str], before: str, after: str) -> list[str]:
    return [line.replace(before, after) for line in lines]


def test_of_two_lasers_in_one_log_one_is_read_and_the_other_named(tmp_path: Path) -> None:
    rear = [flaser(moment, [1.0] * 181).replace("FLASER", "RLASER") for moment in moments(30)]
    both = [line for pair in zip(room_log(60)[1::2], rear * 2, strict=True) for line in pair]
    result = imported(tmp_path, both)
    assert result["scans"] == 60
    assert any("60 FLASER lines are read, 60 RLASER lines are not" in note for note in result["notes"])


@pytest.mark.parametrize("word", ["RLASER", "LASER3"])
def test_a_log_of_another_laser_alone_is_read(tmp_path: Path, word: str) -> None:
    assert imported(tmp_path, renamed(room_log(20), "FLASER", word))["scans"] == 20


def test_raw_scans_without_a_pose_go_with_the_odometry_beside_them(tmp_path: Path) -> None:
    step = math.pi / 180
    lines = []
    for moment in moments(20):
        words = robotlaser(moment, -0.5 * math.pi, step, room_ranges(moment)).split(" ")
        lines += [odom(moment), " ".join(["RAWLASER1", *words[1:191], *words[-3:]])]
    result = imported(tmp_path, lines)
    assert (result["scans"], result["wheel_samples"], result["warnings"]) == (20, 20, [])
    with pytest.raises(DataSetError, match="has no odometry"):
        import_data_set(written(tmp_path / "b.log", lines[1::2]), tmp_path / "other")


def test_scans_with_another_number_of_beams_are_named(tmp_path: Path) -> None:
    lines = [*room_log(20), flaser((2.1, 0.0, -2.0, 0.0), [2.0] * 5)]
    assert any(note.startswith("scans have 181 beams, but 1 of 5;") for note in imported(tmp_path, lines)["notes"])


def test_a_log_of_more_than_fits_into_memory_is_read_up_to_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1.5 million odometry lines, 70 MB, took 1.1 GB."""
    (tmp_path / "a.log").write_text("".join(carmen_line(t, [1.0] * 5, (0, 0, 0), (0, 0, 0)) for t in range(40)))
    monkeypatch.setattr(text_lines, "MOST_KEPT_BYTES", 10_000)
    archive = load_carmen(tmp_path / "a.log")
    assert len(archive.arrays["scan_t"]) == 11
    assert any("what follows line 11 is more than fits" in sentence for sentence in archive.left_out.warnings)
    (tmp_path / "b.log").write_text("".join(f"ODOM 0 0 0 0 0 0 {t} h {t}\n" for t in range(40)))
    with pytest.raises(DataSetError, match=r"holds no usable scan .*what follows line 12 is more than fits"):
        load_carmen(tmp_path / "b.log")
