import math
from pathlib import Path

import pytest

from runtime.calibrate.result import Calibration, Quantity, calibration_lines
from runtime.calibrate.write import configuration_changes, write_configuration
from runtime.errors import ConfigurationError, RunExistsError, StorageError
from runtime.settings.configuration import load_configuration

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
    ("turn more to the left: turning left is 0.4 rad, wanted 2.5 rad",),
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


def test_what_was_refused_keeps_the_value_of_the_base() -> None:
    assert "slam.mount.y_m" not in configuration_changes(FOUND, BASE)


def test_an_imported_recording_has_no_stamps_to_correct() -> None:
    assert "laser.stamp_offset_s" not in configuration_changes(FOUND, "[vehicle]\ntread_m = 0.4\n")


def test_the_file_says_where_its_values_come_from(tmp_path: Path) -> None:
    path = tmp_path / "calibrated.toml"
    write_configuration(FOUND, BASE, path)
    text = path.read_text()
    assert all(f"# {line}" in text for line in calibration_lines(FOUND))


def test_a_file_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "calibrated.toml"
    path.write_text("mine")
    with pytest.raises(RunExistsError, match="exists already"):
        write_configuration(FOUND, BASE, path)
    assert path.read_text() == "mine"


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
