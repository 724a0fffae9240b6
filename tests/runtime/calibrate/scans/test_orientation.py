import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import OdometryPose, WheelCounts
from runtime.calibrate.calibration import calibrate
from runtime.calibrate.drive_data import DriveData, PoseStart, along_arcs
from runtime.calibrate.scans.orientation import Orientation, orientation
from runtime.calibrate.wheel_model import DifferentialModel
from runtime.errors import DataSetError
from slam.pose import Pose2
from tests.support.runtime.made_drives import START, Rover, park_drive

TRUE_MOUNT = (0.32, 0.04, 0.03)


@pytest.fixture(scope="module")
def drive() -> DriveData:
    return park_drive(11, Rover(mount=TRUE_MOUNT, latency_s=0.02, slip=0.005), 60.0)


def hanging(drive: DriveData) -> DriveData:
    return replace(drive, scans=tuple(scan.mirrored() for scan in drive.scans))


def as_poses(drive: DriveData, distance_scale: float = 1.0, turn_scale: float = 1.0) -> DriveData:
    """The same drive of a base that adds up its wheels itself, and wrongly by these factors."""
    series = drive.wheel_series()
    motion = DifferentialModel(START).dead_reckoning(series, DifferentialModel(START).start)
    base = np.column_stack((motion.distances_m / distance_scale, motion.poses[:, 2] / turn_scale))
    headings = base[:, 1]
    middle = 0.5 * (headings[1:] + headings[:-1])
    steps = np.diff(base[:, 0])
    x, y = (np.concatenate(((0.0,), np.cumsum(steps * part))) for part in (np.cos(middle), np.sin(middle)))
    stamps = [round(time * 1e9) + drive.origin_ns for time in series.times_s.tolist()]
    wrapped = np.arctan2(np.sin(headings), np.cos(headings))
    poses = zip(stamps, x.tolist(), y.tolist(), wrapped.tolist(), strict=True)
    return replace(drive, wheels=tuple(OdometryPose(*pose) for pose in poses))


def test_a_laser_that_stands_as_configured_is_left_alone(drive: DriveData) -> None:
    assert orientation([drive], START) == Orientation()


def test_mirrored_scans_are_recognised(drive: DriveData) -> None:
    assert orientation([hanging(drive)], START) == Orientation(mirrored=True)


def test_a_laser_that_looks_backwards_is_recognised(drive: DriveData) -> None:
    backwards = replace(START, body_from_laser=Pose2(0.3, 0.0, math.pi))
    found = orientation([drive], backwards)
    assert not found.mirrored
    assert abs(found.turned_rad) == pytest.approx(math.pi)


def test_wheels_that_both_count_backwards_are_not_taken_for_a_laser_upside_down(drive: DriveData) -> None:
    counts = [sample for sample in drive.wheels if isinstance(sample, WheelCounts)]
    backward = tuple(replace(sample, left=-sample.left, right=-sample.right) for sample in counts)
    assert orientation([replace(drive, wheels=backward)], START) == Orientation()


def test_a_drive_straight_ahead_does_not_tell_left_from_right() -> None:
    straight = park_drive(2, Rover(), 12.0, course_scale=6.0)
    assert orientation([hanging(straight)], START) == Orientation()


def test_mount_latency_and_scales_are_found_from_poses_of_the_base_upside_down_or_not(drive: DriveData) -> None:
    start = PoseStart(body_from_laser=Pose2(0.3, 0.0, 0.0))
    base = as_poses(drive, 1.02, 0.97)
    result = calibrate([base], start)
    assert not result.orientation.mirrored
    expected = {
        "distance_scale": (1.02, 0.01),
        "turn_scale": (0.97, 0.02),
        "laser_x_m": (TRUE_MOUNT[0], 0.03),
        "laser_y_m": (TRUE_MOUNT[1], 0.03),
        "laser_yaw_rad": (TRUE_MOUNT[2], 0.01),
        "laser_latency_s": (0.02, 0.02),
    }
    for name, (value, within) in expected.items():
        found = result.quantity(name)
        assert not found.refused, found
        assert found.value == pytest.approx(value, abs=within), found
    mirrored = calibrate([hanging(base)], start)
    assert mirrored.orientation.mirrored
    assert mirrored.quantity("laser_y_m").value == pytest.approx(result.quantity("laser_y_m").value, abs=1e-3)
    assert mirrored.as_json()["mirrored"] is True


def test_along_arcs_undoes_what_a_base_adds_up() -> None:
    turn = np.array((0.0, 0.3, 0.7, 0.7, -1.9, -2.5))
    steps = np.array((0.2, 0.2, -0.1, 0.3, 0.1))
    poses = [Pose2(5.0, 1.0, 2.0)]
    for step, more in zip(steps, np.diff(turn), strict=True):
        half = 0.5 * more
        chord = step * (math.sin(half) / half if half else 1.0)
        poses.append(poses[-1] @ Pose2(chord * math.cos(half), chord * math.sin(half), more))
    found = along_arcs(np.array([pose.as_array() for pose in poses]))
    np.testing.assert_allclose(found[:, 0], np.concatenate(((0.0,), np.cumsum(steps))), atol=1e-12)
    np.testing.assert_allclose(found[1:3, 1], turn[1:3], atol=1e-12)


def test_wheel_counts_of_a_pose_configuration_are_refused() -> None:
    with pytest.raises(DataSetError, match="pose"):
        calibrate([park_drive(2, Rover(), 3.0)], PoseStart())
