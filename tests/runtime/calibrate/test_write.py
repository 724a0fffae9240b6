import math
import os
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from runtime.calibrate.result import Calibration, Quantity, calibration_lines
from runtime.calibrate.scans.orientation import UPSIDE_DOWN
from runtime.calibrate.write import backup_of, configuration_changes, text_to_write_into, write_configuration
from runtime.errors import ConfigurationError, StorageError
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.source_tree import CONFIG

BASE = """
rover = "calibrated"
[laser]
url = "tcp://192.168.0.10:10940"
stamp_offset_s = -0.01
[encoders]
[vehicle]
tread_m = 0.5
[slam.odometry]
slip_m_per_sqrt_m = 0.02
"""

FOUND = Calibration(
    ("a run",),
    (
        Quantity("wheel_radius_left_m", 0.1241, 0.1231, 0.1251),
        Quantity("wheel_radius_right_m", 0.1259, 0.1249, 0.1269),
        Quantity("tread_m", 0.512, 0.5, 0.524),
        Quantity("laser_x_m", 0.31, 0.29, 0.33),
        Quantity("laser_y_m", 0.0, 0.0, 0.0, "turn more to the left"),
        Quantity("laser_yaw_rad", 0.02, 0.01, 0.03),
        Quantity("laser_latency_s", 0.03, 0.02, 0.04),
        Quantity("slip_m_per_sqrt_m", 0.008, 0.007, 0.009),
        Quantity("lateral_m_per_sqrt_m", 1e-5, 0.0, 0.004),
        Quantity("range_noise_m", 0.012, 0.011, 0.013),
    ),
    (),
    ("turn more to the left: turning left was 0.4 rad, and 2.5 are needed",),
    50,
    1,
    0,
)


def test_the_written_configuration_can_be_used_at_once(tmp_path: Path) -> None:
    path = tmp_path / "calibrated.toml"
    write_configuration(FOUND, BASE, path)
    after = load_configuration(path)
    odometry = after.slam.odometry
    assert (odometry.wheel_radius_left_m, odometry.wheel_radius_right_m, odometry.tread_m) == (0.1241, 0.1259, 0.512)
    assert (after.slam.mount.x_m, after.slam.mount.y_m, after.slam.mount.yaw_rad) == (0.31, 0.0, 0.02)
    assert after.laser is not None
    assert after.laser.stamp_offset_s == pytest.approx(-0.04)
    assert after.laser.url == "tcp://192.168.0.10:10940"
    assert after.encoders is not None
    assert after.encoders.vehicle == after.vehicle
    assert after.vehicle.counts_per_metre == pytest.approx(4096 / (2 * math.pi * 0.125))
    assert odometry.slip_m_per_sqrt_m == 0.008
    assert odometry.lateral_m_per_sqrt_m == 0.003  # the filter needs some
    assert odometry.radius_uncertainty == pytest.approx(0.0005 / 0.1241, rel=0.01)
    assert after.slam.front_end.sigma_range_m == 0.012


def test_a_file_that_is_there_is_kept_as_it_was_and_a_shipped_name_can_be_started_from(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    text = text_to_write_into(path, Path("mock"))
    assert text is not None
    write_configuration(FOUND, text, path, text)
    assert not backup_of(path).exists()
    before = path.read_bytes()
    wider = replace(FOUND, quantities=(Quantity("tread_m", 0.52, 0.51, 0.53),))
    for again in (wider, wider):  # what changes nothing keeps nothing
        write_configuration(again, text, path, text_to_write_into(path))
    assert backup_of(path).read_bytes() == before


def test_a_radius_that_would_change_nothing_is_refused_before_the_work(tmp_path: Path) -> None:
    steered = CONFIG / "examples" / "steered.toml"
    assert text_to_write_into(tmp_path / "a.toml", steered)
    path = tmp_path / "steered.toml"
    path.write_text(steered.read_text().replace(", counts_per_unit = 3259.493", ""))
    shutil.copy(steered.with_suffix(".dbc"), tmp_path)
    with pytest.raises(ConfigurationError, match=r"left.counts_per_unit: expected .* counts_per_unit = 3259.49"):
        text_to_write_into(path)


def test_what_was_refused_keeps_the_value_of_the_base() -> None:
    assert "slam.mount.y_m" not in configuration_changes(FOUND, BASE)


def test_an_imported_recording_has_no_stamps_to_correct() -> None:
    assert "laser.stamp_offset_s" not in configuration_changes(FOUND, "[vehicle]\ntread_m = 0.4\n")


def test_the_file_says_where_its_values_come_from(tmp_path: Path) -> None:
    path = tmp_path / "calibrated.toml"
    write_configuration(FOUND, BASE, path)
    text = path.read_text()
    assert all(f"# {line}" in text for line in calibration_lines(FOUND))


MINE = """# my rover
rover = "calibrated"  # its name

[vehicle]  # measured with a ruler
tread_m = 0.5     # between the middles of the tyres
wheel_radius_left_m = 0.125
[slam]
mount = {x_m = 0.25, yaw_rad = 0.0}  # on the roof
odometry.slip_m_per_sqrt_m = 0.02
[laser]
url = "tcp://192.168.0.10:10940"
stamp_offset_s = -0.01
[encoders]
"""


def test_a_file_that_is_there_keeps_its_comments_and_all_that_was_not_found(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(MINE)
    path.chmod(0o640)
    into = text_to_write_into(path)
    assert into == MINE
    changed = write_configuration(FOUND, MINE, path, into)
    text = path.read_text()
    assert {"slam.mount.x_m", "vehicle.tread_m", "laser.stamp_offset_s"} <= set(changed)
    assert "tread_m = 0.512     # between the middles of the tyres\n" in text
    assert "mount = {x_m = 0.31, yaw_rad = 0.02}  # on the roof\n" in text
    assert "odometry.slip_m_per_sqrt_m = 0.008\n" in text
    assert "y_m" not in text
    assert [line.partition("#")[2] for line in MINE.splitlines() if "#" in line] == [
        line.partition("#")[2] for line in text.splitlines() if "#" in line
    ]
    after = load_configuration(path)
    assert after.slam.front_end.sigma_range_m == 0.012
    assert path.stat().st_mode & 0o777 == 0o640
    assert {name.name for name in tmp_path.iterdir()} == {"rover.toml", "rover.toml.before"}


def test_what_was_found_as_it_stands_there_is_no_change(tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(MINE)
    write_configuration(FOUND, MINE, path, MINE)
    first = path.read_text()
    assert write_configuration(FOUND, MINE, path, first) == ()
    assert path.read_text() == first


def test_a_new_file_holds_only_what_is_no_default(tmp_path: Path) -> None:
    path = tmp_path / "calibrated.toml"
    write_configuration(FOUND, load_configuration_text(BASE).text, path)
    tree = tomllib.loads(path.read_text())
    assert set(tree) == {"rover", "vehicle", "slam", "laser", "encoders"}
    assert set(tree["laser"]) == {"stamp_offset_s"}
    assert set(tree["slam"]) == {"odometry", "mount", "front_end"}


def test_a_new_file_takes_the_comments_of_the_configuration_that_was_given(tmp_path: Path) -> None:
    (tmp_path / "given.toml").write_text(MINE)
    path = tmp_path / "new.toml"
    write_configuration(FOUND, MINE, path, text_to_write_into(path, tmp_path / "given.toml"))
    assert path.read_text().startswith("# my rover\n")
    assert (tmp_path / "given.toml").read_text() == MINE


@pytest.mark.parametrize(
    ("name", "content", "error"),
    [("rover.toml", "mine", ConfigurationError), ("no/rover.toml", None, StorageError)],
)
def test_where_nothing_can_be_written_is_found_before_the_work_begins(
    tmp_path: Path, name: str, content: str | None, error: type[Exception]
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(error):
        text_to_write_into(path)


def test_a_laser_that_turned_out_to_hang_upside_down_is_written() -> None:
    changes = configuration_changes(replace(FOUND, orientation=UPSIDE_DOWN), BASE)
    assert changes["slam.mount.upside_down"] is True
    hanging = BASE + "[slam.mount]\nupside_down = true\n"
    assert configuration_changes(replace(FOUND, orientation=UPSIDE_DOWN), hanging)["slam.mount.upside_down"] is False
    assert "slam.mount.upside_down" not in configuration_changes(FOUND, hanging)


def test_a_link_of_ours_is_followed_and_one_of_another_or_to_nothing_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, target = tmp_path / "rover.toml", tmp_path / "real.toml"
    path.symlink_to(target)
    with pytest.raises(StorageError, match=r"rover\.toml: is a link to nothing, which is not followed"):
        text_to_write_into(path, Path("mock"))
    target.write_text(BASE)
    assert text_to_write_into(path) == BASE
    us = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    if us:  # a link of root is trusted
        with pytest.raises(StorageError, match=r"rover\.toml: is a link of another user"):
            text_to_write_into(path)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be written"):
        write_configuration(FOUND, BASE, tmp_path / "no" / "calibrated.toml")


def test_nothing_found_writes_nothing(tmp_path: Path) -> None:
    nothing = Calibration(("a run",), (Quantity("tread_m", 0.0, 0.0, 0.0, "no"),), (), ("drive farther",), 0, 0, 9)
    with pytest.raises(ConfigurationError, match="drive farther"):
        write_configuration(nothing, BASE, tmp_path / "calibrated.toml")
    assert not (tmp_path / "calibrated.toml").exists()


@pytest.mark.parametrize(("taken_off", "expected"), [("", 0.03), ("[data_set]\nlaser_latency_s = 0.1\n", 0.13)])
def test_the_latency_of_a_recorded_data_set_goes_where_its_importer_takes_it_off(
    taken_off: str, expected: float
) -> None:
    changes = configuration_changes(FOUND, taken_off + "[vehicle]\ntread_m = 0.5\n")
    assert changes["data_set.laser_latency_s"] == pytest.approx(expected)
    assert "laser.stamp_offset_s" not in changes
