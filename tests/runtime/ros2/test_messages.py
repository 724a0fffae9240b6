"""What nav2 and robot_localization read out of scan, odometry, transforms and path, by a reader nobody here wrote."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from runtime.messages.definitions import construct, deserialize, serialize
from runtime.messages.ros import header, ros_pose
from runtime.ros2.laser_scan import SCAN, scan_bytes
from runtime.ros2.markers import landmark_bytes
from runtime.ros2.odometry import ODOMETRY, UNKNOWN, Dead, OdometryTrack, odometry_bytes
from runtime.ros2.poses import MOST_PATH_POSES, PATH, POSES, STAMPED, DrivenPath, particle_bytes
from runtime.ros2.transforms import TF, static_bytes, transform_bytes
from runtime.ros2.vehicle import Frames, Vehicle
from slam.estimate import Estimate
from slam.pose import Pose2, rotated
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import MountSettings
from tests.support.runtime.recorded_values import make_estimate, make_tick
from tests.support.runtime.ros_types import FirstMarker, LaserScan, Odometry, TransformMessage, read

WALL_NS = 1_700_000_000_000_000_000
TICK_NS = 100_000_000


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def test_a_thinned_scan_keeps_its_geometry_and_says_infinity_where_nothing_was() -> None:
    scan = make_tick(7, np.random.default_rng(3)).scan
    assert isinstance(scan, Scan)
    thin = read(LaserScan, scan_bytes(scan, WALL_NS, Vehicle(scan_period_s=0.1), 3))
    assert len(thin.ranges) == 361
    bearings_rad = thin.angle_min + thin.angle_increment * np.arange(361)
    np.testing.assert_allclose(bearings_rad, scan.bearings_rad[::3], atol=1e-5)
    nothing = np.isnan(scan.ranges_m[::3])
    expected = np.where(nothing, np.float32(np.inf), scan.ranges_m[::3])
    np.testing.assert_array_equal(np.array(thin.ranges, np.float32), expected)
    assert thin.scan_time == pytest.approx(0.1)
    assert thin.range_min == pytest.approx(0.1)


@pytest.mark.parametrize(("beam_period_s", "stamp_beam"), [(25e-6, 540), (25e-6, 0), (-25e-6, 1080), (-25e-6, 0)])
def test_the_stamp_is_the_first_rays_whatever_way_the_laser_turns(beam_period_s: float, stamp_beam: int) -> None:
    bearings_rad = uniform_bearings(-2.35, math.pi / 720, 1081)
    ranges_m = np.arange(1.0, 1082.0, dtype=np.float32)
    scan = Scan(5_000_000_000, ranges_m, bearings_rad, beam_period_s, stamp_beam)
    message = deserialize(SCAN, scan_bytes(scan, WALL_NS, Vehicle()))
    for beam in (0, 500, 1080):
        bearing_rad = message.angle_min + beam * message.angle_increment
        ours = int(np.abs(bearings_rad - bearing_rad).argmin())
        assert message.ranges[beam] == ranges_m[ours]
        taken_ns = stamp_of(message) + beam * message.time_increment * 1e9
        assert taken_ns == pytest.approx(WALL_NS + scan.stamp_ns + (ours - stamp_beam) * beam_period_s * 1e9, abs=500)
    assert message.time_increment > 0.0


def test_a_laser_that_sees_nothing_at_all_clears_no_obstacle() -> None:
    scan = Scan(0, np.full(4, np.nan, np.float32), uniform_bearings(-1.0, 0.5, 4))
    assert np.isnan(deserialize(SCAN, scan_bytes(scan, 0, Vehicle())).ranges).all()


def estimates(step: Pose2, count: int) -> Iterator[Estimate]:
    pose, first = Pose2(), make_estimate(0, np.random.default_rng(1))
    for number in range(count):
        yield replace(first, stamp_ns=number * TICK_NS, odom_from_body=pose, counts={})
        pose = pose @ step


def driven(step: Pose2, count: int, settings: OdometrySettings | None = None) -> Dead:
    track = OdometryTrack(settings or OdometrySettings())
    return [track.take(estimate) for estimate in estimates(step, count)][-1]


def test_odometry_says_its_twist_in_the_body_frame() -> None:
    dead = driven(Pose2(0.05, 0.001, 0.02), 100)
    message = read(Odometry, odometry_bytes(WALL_NS, dead))
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    whole = deserialize(ODOMETRY, odometry_bytes(WALL_NS, dead, Frames("r1")))
    assert (whole.header.frame_id, whole.child_frame_id) == ("r1/odom", "r1/base_link")
    assert whole.twist.twist.linear.x == pytest.approx(0.5)
    assert whole.twist.twist.linear.y == pytest.approx(0.01)
    assert whole.twist.twist.angular.z == pytest.approx(0.2)


@pytest.mark.parametrize("model", ["differential", "steered", "speed_yaw_rate", "pose"])
@pytest.mark.parametrize("step", [Pose2(), Pose2(0.1, 0.0, 0.0), Pose2(0.1, 0.0, 0.05), Pose2(0.0, 0.0, 0.1)])
def test_covariances_are_covariances_and_those_of_the_pose_never_shrink(model: Any, step: Pose2) -> None:
    track, least = OdometryTrack(OdometrySettings(model=model)), 0.0
    for number, estimate in enumerate(estimates(step, 60)):
        dead = track.take(estimate)
        message = deserialize(ODOMETRY, odometry_bytes(0, dead))
        for covariance in (message.pose.covariance.reshape(6, 6), message.twist.covariance.reshape(6, 6)):
            assert np.isfinite(covariance).all()
            assert np.linalg.eigvalsh(covariance)[0] >= -1e-12
        assert dead.covariance[2, 2] >= least
        least = dead.covariance[2, 2]
        assert (dead.twist_covariance[0, 0] == UNKNOWN) == (number == 0)


def test_the_covariance_is_that_of_many_drives_with_such_errors() -> None:
    """Monte Carlo: wheels off by their constants and by slip, the same drive 3000 times."""
    settings, rng = OdometrySettings(radius_uncertainty=0.01, tread_uncertainty=0.02), np.random.default_rng(2)
    step, count, drives = Pose2(0.1, 0.0, 0.02), 100, 3000
    scales = 1.0 + settings.radius_uncertainty * rng.standard_normal((2, drives))
    treads = settings.tread_m * (1.0 + settings.tread_uncertainty * rng.standard_normal(drives))
    x, y, heading = np.zeros((3, drives))
    wheels_m = np.array((step.x_m - 0.5 * settings.tread_m * 0.02, step.x_m + 0.5 * settings.tread_m * 0.02))
    slips = settings.slip_m_per_sqrt_m * np.sqrt(wheels_m)[:, None]
    for _ in range(count - 1):
        left, right = wheels_m[:, None] * scales + slips * rng.standard_normal((2, drives))
        turn, forward = (right - left) / treads, 0.5 * (left + right)
        x += forward * np.cos(heading + 0.5 * turn)
        y += forward * np.sin(heading + 0.5 * turn)
        heading += turn
    got = driven(step, count, settings).covariance
    np.testing.assert_allclose(np.sqrt(np.diag(got)), np.std((x, y, heading), axis=1), rtol=0.25)


def test_wheels_that_were_silent_leave_the_twist_wide() -> None:
    track = OdometryTrack(OdometrySettings())
    first, second = estimates(Pose2(), 2)
    track.take(first)
    silent = track.take(replace(second, counts={"odometry_known": 0.0}))
    assert silent.twist_covariance[0, 0] > 1.0
    assert silent.covariance[0, 0] > 0.05


def test_map_to_odom_times_odom_to_body_is_the_pose() -> None:
    estimate = make_estimate(0, np.random.default_rng(8))
    poses = []
    data = transform_bytes(0, estimate.map_from_body, estimate.odom_from_body)
    for each in read(TransformMessage, data).transforms:
        heading_rad = 2.0 * np.arctan2(each.rotation.z, each.rotation.w)
        poses.append(Pose2(each.translation.x, each.translation.y, heading_rad))
    np.testing.assert_allclose((poses[0] @ poses[1]).as_array(), estimate.map_from_body.as_array(), atol=1e-12)


@pytest.mark.parametrize("upside_down", [False, True])
def test_the_static_transform_lays_a_beam_where_the_filter_does(upside_down: bool) -> None:
    mount = MountSettings(x_m=0.3, y_m=-0.1, yaw_rad=0.7, upside_down=upside_down)
    scan = Scan(0, np.array((2.0, 3.0), np.float32), np.array((0.2, 0.9)))
    (each,) = deserialize(TF, static_bytes(0, Vehicle(mount))).transforms
    turn, at = each.transform.rotation, each.transform.translation
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    matrix = np.array(((1 - 2 * (y * y + z * z), 2 * (x * y - z * w)), (2 * (x * y + z * w), 1 - 2 * (x * x + z * z))))
    beams = scan.ranges_m[:, None] * rotated(np.array((1.0, 0.0)), scan.bearings_rad)
    theirs = beams @ matrix.T + (at.x, at.y)
    upright = mount.upright(scan)
    ours = mount.as_pose().transform(upright.ranges_m[:, None] * rotated(np.array((1.0, 0.0)), upright.bearings_rad))
    np.testing.assert_allclose(np.sort(theirs, axis=0), np.sort(ours, axis=0), atol=1e-6)
    assert (each.header.frame_id, each.child_frame_id) == ("base_link", "laser")


def test_landmarks_stand_where_the_map_has_them() -> None:
    landmarks = make_estimate(0, np.random.default_rng(3)).landmarks
    assert landmarks is not None
    array = read(FirstMarker, landmark_bytes(landmarks, 5))
    assert array.count == 1
    assert [(point.x, point.y) for point in array.marker.points] == [tuple(mean) for mean in landmarks.means_m]


def test_a_path_of_hours_stays_small_and_keeps_its_ends() -> None:
    path = DrivenPath()
    for number in range(10 * MOST_PATH_POSES):
        path.add(number * TICK_NS, Pose2(0.2 * number, 0.0, 0.0))
    poses = deserialize(PATH, path.as_bytes(WALL_NS)).poses
    assert len(poses) <= MOST_PATH_POSES
    assert poses[0].pose.position.x == 0.0
    assert poses[-1].pose.position.x > 0.2 * 9.9 * MOST_PATH_POSES


@pytest.mark.parametrize("prefix", ["", "a", "ro", "bot", "rov1", "rover"])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_paths_and_particles_have_the_bytes_that_a_serializer_of_others_makes(prefix: str, count: int) -> None:
    frames, rng = Frames(prefix), np.random.default_rng(count)
    particles = rng.uniform(-3.0, 3.0, (count, 3))
    poses = [Pose2(*row) for row in particles.tolist()]
    path = DrivenPath()
    for k, pose in enumerate(poses):
        path.add(WALL_NS + k * TICK_NS, pose)
    stamped = [
        construct(STAMPED, header=header(WALL_NS + k * TICK_NS, frames("map")), pose=ros_pose(pose))
        for k, pose in enumerate(poses)
    ]
    head = header(WALL_NS, frames("map"))
    expected = serialize(PATH, construct(PATH, header=head, poses=stamped))
    assert_same_bytes(path.as_bytes(WALL_NS, frames), expected)
    expected = serialize(POSES, construct(POSES, header=head, poses=list(map(ros_pose, poses))))
    assert_same_bytes(particle_bytes(WALL_NS, particles, frames), expected)


def assert_same_bytes(ours: bytes, theirs: bytes) -> None:
    """But for the last bit of a sine, which numpy may round otherwise."""
    assert len(ours) == len(theirs)
    differing = np.flatnonzero(np.frombuffer(ours, np.uint8) != np.frombuffer(theirs, np.uint8))
    assert all(abs(ours[k] - theirs[k]) == 1 for k in differing)
    assert len(differing) < 0.02 * len(ours)
