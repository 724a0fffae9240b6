import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import Scan, uniform_bearings
from slam.front_end.deskew import UNTIMED_S, Twist, deskew, sharp_to_m, with_motion_noise
from slam.observations import Features
from slam.pose import Pose2
from tests.support.examples import examples

BEARINGS = uniform_bearings(-2.0, 0.1, 41)


def arc(twist: Twist, seconds: float) -> Pose2:
    """Pose after a constant twist, in many short steps."""
    pose, steps = Pose2(), 2000
    part = seconds / steps
    turn = twist.yaw_rate_radps * part
    chord = Pose2(twist.speed_mps * part, twist.lateral_mps * part, 0.0)
    half, rest = Pose2(0.0, 0.0, 0.5 * turn), Pose2(0.0, 0.0, turn - 0.5 * turn)
    for _ in range(steps):
        pose = pose @ half @ chord @ rest
    return pose


@examples(15)
@given(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0), st.integers(0, 40), st.floats(-3.0, 3.0))
def test_points_are_where_the_laser_really_was_when_each_beam_was_measured(
    speed: float, lateral: float, yaw_rate: float, stamp_beam: int, mount_heading: float
) -> None:
    twist, mount = Twist(speed, lateral, yaw_rate), Pose2(0.4, -0.2, mount_heading)
    ranges = np.linspace(1.0, 9.0, 41).astype(np.float32)
    beams = deskew(Scan(0, ranges, BEARINGS, 0.002, stamp_beam, 60.0), twist, mount, 0.1, 60.0)
    for beam in (0, 17, 40):
        body = arc(twist, (beam - stamp_beam) * 0.002)
        stamp_from_beam = mount.inverse() @ body @ mount
        ray = np.array((math.cos(BEARINGS[beam]), math.sin(BEARINGS[beam])))
        expected = stamp_from_beam.transform(float(ranges[beam]) * ray[None])[0]
        np.testing.assert_allclose(beams.points_m[beam], expected, atol=1e-6)
        assert beams.ranges_m[beam] == pytest.approx(np.hypot(*expected), abs=1e-6)
        assert beams.bearings_rad[beam] == pytest.approx(math.atan2(expected[1], expected[0]), abs=1e-6)


def test_a_rover_at_rest_changes_no_measurement() -> None:
    ranges = np.linspace(1.0, 9.0, 41).astype(np.float32)
    beams = deskew(Scan(0, ranges, BEARINGS, 0.002, 0, 60.0), Twist(), Pose2(0.3, 0.0, 0.0), 0.1, 60.0)
    np.testing.assert_array_equal(beams.ranges_m, ranges.astype(np.float64))
    np.testing.assert_array_equal(beams.bearings_rad, BEARINGS)


@pytest.mark.parametrize(
    ("period_s", "yaw_rate", "expected_m"),
    [(0.0, 0.5, 30.0), (0.0, -0.5, 30.0), (0.0, 0.0, math.inf), (0.002, 0.5, math.inf), (-0.002, 0.5, math.inf)],
)
def test_returns_blur_with_range_where_the_rover_turns_and_nobody_knows_when_each_was_taken(
    period_s: float, yaw_rate: float, expected_m: float
) -> None:
    scan = Scan(0, np.full(41, 5.0, dtype=np.float32), BEARINGS, period_s, 0, 60.0)
    assert sharp_to_m(scan, Twist(1.0, 0.0, yaw_rate), 30.0 * 0.5 * UNTIMED_S) == pytest.approx(expected_m)


def test_what_is_no_measurement_becomes_no_return() -> None:
    ranges = np.full(41, 5.0, dtype=np.float32)
    ranges[:7] = (math.nan, math.inf, -math.inf, -1.0, 0.0, 0.05, 30.0)
    beams = deskew(Scan(0, ranges, BEARINGS, 0.0, 0, 30.0), Twist(1.0), Pose2(), 0.1, 60.0)
    assert np.isnan(beams.ranges_m[:7]).all()
    assert np.isnan(beams.points_m[:7]).all()
    assert np.isfinite(beams.ranges_m[7:]).all()
    assert np.isfinite(beams.rays).all()


@pytest.mark.parametrize("count", [0, 1])
def test_a_scan_of_almost_nothing_is_a_scan(count: int) -> None:
    scan = Scan(0, np.full(count, 3.0, dtype=np.float32), np.zeros(count))
    assert len(deskew(scan, Twist(1.0), Pose2(), 0.1, 60.0)) == count


def test_clockwise_beams_are_refused_with_the_remedy() -> None:
    scan = Scan(0, np.ones(41, dtype=np.float32), BEARINGS[::-1].copy())
    with pytest.raises(ValueError, match="reverse the arrays"):
        deskew(scan, Twist(), Pose2(), 0.1, 60.0)


def test_bearings_in_degrees_are_refused() -> None:
    scan = Scan(0, np.ones(41, dtype=np.float32), np.degrees(BEARINGS))
    with pytest.raises(ValueError, match=r"span more than two turns; expected radians"):
        deskew(scan, Twist(), Pose2(), 0.1, 60.0)


def motion_noise_scan(beam_period_s: float) -> Scan:
    return Scan(0, np.full(5, 8.0, np.float32), uniform_bearings(-0.2, 0.1, 5), beam_period_s, 0)


def features_at(beams: tuple[int, ...]) -> Features:
    count = len(beams)
    covariances = np.tile(np.diag((1e-4, 1e-6)), (count, 1, 1))
    return Features(
        0, np.full(count, 8.0), np.zeros(count), covariances, np.ones(count, bool), np.full(count, -1), np.array(beams)
    )


def test_a_feature_far_from_the_stamp_takes_its_part_of_the_motions_noise() -> None:
    motion = np.diag((4e-4, 0.0, 1e-4))
    wider = with_motion_noise(features_at((0, 2, 4)), motion_noise_scan(0.025), motion, 0.1).covariances
    np.testing.assert_allclose(wider[:, 1, 1] - 1e-6, (0.0, 0.5e-4, 1e-4))
    np.testing.assert_allclose(wider[:, 0, 0] - 1e-4, (0.0, 2e-4, 4e-4))


def test_features_that_were_measured_at_once_or_have_no_beam_stay_as_they_are() -> None:
    motion = np.diag((4e-4, 0.0, 1e-4))
    features = features_at((4,))
    assert with_motion_noise(features, motion_noise_scan(0.0), motion, 0.1) is features
    without_beam = with_motion_noise(features_at((-1,)), motion_noise_scan(0.025), motion, 0.1)
    np.testing.assert_array_equal(without_beam.covariances, features.covariances)
