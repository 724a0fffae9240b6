"""Dead reckoning: exact, interpolated to the stamp, and with a covariance that holds."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import FloatArray, OdometryPose, SpeedSteering, SpeedYawRate, WheelCounts, WheelSample
from slam.odometry.odometry import Increment, Odometry
from slam.pose import Pose2, wrap_rad
from slam.settings.odometry import OdometrySettings
from tests.support.slam.scenes import arc_pose

MS = 1_000_000
COUNT_M = 2.0 * math.pi * 0.125 / 4096


def odometry(model: str = "differential", **changes: object) -> Odometry:
    return Odometry(OdometrySettings.model_validate({"model": model, **changes}))


def counts(stamp_ms: int, left_m: float, right_m: float, valid: bool = True) -> WheelCounts:
    return WheelCounts(stamp_ms * MS, left_m / COUNT_M, right_m / COUNT_M, valid)


def close(pose: Pose2, expected: tuple[float, float, float], tolerance: float = 1e-9) -> None:
    assert (pose.x_m, pose.y_m) == pytest.approx(expected[:2], abs=tolerance)
    assert wrap_rad(pose.heading_rad - expected[2]) == pytest.approx(0.0, abs=tolerance)


def test_a_full_circle_ends_where_it_began() -> None:
    wheels = odometry()
    tread, radius = 0.5, 3.0
    for step in range(101):
        angle = 2.0 * math.pi * step / 100
        wheels.add((counts(20 * step, angle * (radius - tread / 2), angle * (radius + tread / 2)),))
    wheels.take_until(2000 * MS)
    close(wheels.odom_from_body, (0.0, 0.0, 0.0))


def test_one_large_arc_is_exact_and_no_polygon() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(100, 1.0, 2.0)))
    wheels.take_until(100 * MS)
    close(wheels.odom_from_body, tuple(arc_pose(np.zeros(3), 1.5, 2.0)))


def test_the_same_course_comes_out_of_every_kind_of_wheel_sample() -> None:
    speed, yaw_rate, base, offset = 1.2, 0.4, 2.83, 0.76
    steering = math.atan(base * yaw_rate / speed)
    measured = speed * (1.0 - math.tan(steering) * offset / base)
    stamps = range(0, 1001, 25)

    def pose_at(stamp_ms: int) -> FloatArray:
        return arc_pose(np.zeros(3), speed * stamp_ms / 1000, yaw_rate * stamp_ms / 1000)

    def travel(stamp_ms: int) -> tuple[float, float]:
        seconds = stamp_ms / 1000
        return (speed - 0.25 * yaw_rate) * seconds, (speed + 0.25 * yaw_rate) * seconds

    samples: dict[str, Callable[[int], WheelSample]] = {
        "differential": lambda t: counts(t, *travel(t)),
        "steered": lambda t: SpeedSteering(t * MS, measured, steering),
        "speed_yaw_rate": lambda t: SpeedYawRate(t * MS, speed, yaw_rate),
        "pose": lambda t: OdometryPose(t * MS, *pose_at(t)),
    }
    for model, sample in samples.items():
        wheels = odometry(model)
        wheels.add(tuple(sample(t) for t in stamps))
        for scan_ms in (110, 333, 712, 990):
            wheels.take_until(scan_ms * MS)
            close(wheels.odom_from_body, tuple(pose_at(scan_ms)))


@given(st.lists(st.integers(1, 999), min_size=1, max_size=12, unique=True))
def test_where_scans_fall_between_the_samples_changes_nothing(scans_ms: list[int]) -> None:
    generator = np.random.default_rng(1)
    steps = np.cumsum(generator.uniform(0.0, 0.03, (51, 2)), axis=0)
    samples = tuple(counts(20 * k, *steps[k]) for k in range(51))
    often, once = odometry(), odometry()
    often.add(samples)
    once.add(samples)
    for scan_ms in [*sorted(scans_ms), 1000]:
        often.take_until(scan_ms * MS)
    once.take_until(1000 * MS)
    direct = once.odom_from_body
    close(often.odom_from_body, (direct.x_m, direct.y_m, direct.heading_rad))


@given(st.lists(st.integers(1, 60), min_size=2, max_size=20))
def test_samples_that_come_late_are_caught_up_with(delays: list[int]) -> None:
    """A scan ahead of the newest sample extrapolates; what the wheels then report is the total, so nothing drifts."""
    wheels, stamp_ms, total = odometry(), 0, 0.0
    for delay in delays:
        wheels.add((counts(stamp_ms, total, total),))
        wheels.take_until((stamp_ms + delay) * MS)
        stamp_ms += delay + 20
        total += 0.01 * delay
    wheels.add((counts(stamp_ms, total, total),))
    wheels.take_until(stamp_ms * MS)
    assert wheels.odom_from_body.x_m == pytest.approx(total, abs=1e-9)


def test_extrapolation_ends_after_a_tenth_of_a_second() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.02, 0.02)))
    wheels.take_until(20 * MS)
    near, far = wheels.predicted(100 * MS), wheels.predicted(2000 * MS)
    assert near.mean[0] == pytest.approx(0.08, abs=1e-4)
    assert far.mean[0] == pytest.approx(0.1, abs=1e-4)
    assert not far.known
    assert far.covariance[0, 0] > 0.5**2


def test_a_prediction_consumes_nothing() -> None:
    wheels, other = odometry(), odometry()
    samples = (counts(0, 0.0, 0.0), counts(50, 0.05, 0.06), counts(100, 0.1, 0.14))
    for each in (wheels, other):
        each.add(samples)
    wheels.predicted(70 * MS)
    np.testing.assert_array_equal(wheels.take_until(100 * MS).mean, other.take_until(100 * MS).mean)


@pytest.mark.parametrize(
    ("model", "still"),
    [
        ("differential", lambda t: counts(t, 5.0, 7.0)),
        ("steered", lambda t: SpeedSteering(t * MS, 0.0, 0.3)),
        ("speed_yaw_rate", lambda t: SpeedYawRate(t * MS, 0.0, 0.0)),
        ("pose", lambda t: OdometryPose(t * MS, 1.0, 2.0, 0.5)),
    ],
)
def test_standing_still_has_no_noise_at_all(model: str, still: Callable[[int], WheelSample]) -> None:
    wheels = odometry(model)
    wheels.add(tuple(still(t) for t in range(0, 301, 20)))
    wheels.take_until(100 * MS)
    increment = wheels.take_until(290 * MS)
    assert increment.at_rest
    assert increment.rolling_s == 0.0
    assert not increment.mean.any()
    assert not increment.covariance.any()


def test_for_how_long_it_rolled_leaves_out_where_it_stood() -> None:
    wheels = odometry()
    way = [*[0.0] * 100, *np.linspace(0.0, 0.5, 51)]
    wheels.add(tuple(counts(20 * step, way_m, way_m) for step, way_m in enumerate(way)))
    wheels.take_until(0)
    assert wheels.predicted(1900 * MS).rolling_s == 0.0
    assert wheels.predicted(2480 * MS).rolling_s == pytest.approx(0.48)
    wheels.take_until(3000 * MS)
    assert wheels.take_until(4000 * MS).rolling_s == pytest.approx(1.0), "nobody says that it stands"


def test_an_encoder_that_toggles_by_one_count_still_stands() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(50, COUNT_M, 0.0), counts(100, 0.0, 0.0)))
    wheels.take_until(0)
    assert wheels.take_until(50 * MS).at_rest


def test_a_rover_without_wheel_samples_is_not_at_rest() -> None:
    wheels = odometry()
    wheels.take_until(0)
    increment = wheels.take_until(100 * MS)
    assert not increment.at_rest
    assert not increment.known
    assert increment.covariance[0, 0] > 0.0


def test_a_silent_wheel_means_unknown_motion_and_not_none() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01), counts(40, 9.0, 0.0, valid=False)))
    lost = wheels.take_until(520 * MS)
    assert not lost.known
    assert not lost.at_rest
    assert math.sqrt(lost.covariance[0, 0]) > 0.1
    wheels.add((replace(counts(540, 0.27, 0.27), unbroken=True),))
    wheels.take_until(540 * MS)
    assert wheels.odom_from_body.x_m == pytest.approx(0.27)


def test_samples_out_of_order_not_finite_or_of_another_kind_are_refused_and_counted() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01), counts(20, 0.5, 0.5), counts(10, 0.9, 0.9)))
    wheels.add((counts(40, math.nan, 0.0), SpeedYawRate(50 * MS, 1.0, 0.0), counts(60, 0.03, 0.03)))
    wheels.take_until(60 * MS)
    assert wheels.odom_from_body.x_m == pytest.approx(0.03)
    assert wheels.refused == {"wheel_stamps": 2, "wheel_values": 1, "wheel_kinds": 1, "wheel_jumps": 0}


def test_a_jump_of_the_counts_moves_nothing_and_is_counted() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01), counts(40, 500.0, 0.0), counts(60, 500.01, 0.01)))
    wheels.take_until(60 * MS)
    assert wheels.odom_from_body.x_m == pytest.approx(0.02)
    assert wheels.refused["wheel_jumps"] == 1


def test_nothing_is_moved_towards_a_jump_before_it_is_known_to_be_one() -> None:
    """A scan between a good sample and a foreign one took a part of the way there."""
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01), counts(40, 500.0, 500.0)))
    assert wheels.take_until(30 * MS).mean[0] < 0.02


def test_a_jump_sideways_of_a_reported_pose_moves_nothing_and_is_counted() -> None:
    """The particles' grid reached for it: 20 GB, and the process was killed."""
    wheels = odometry("pose")
    wheels.add(tuple(OdometryPose(at * MS, 0.0, y, 0.0) for at, y in ((0, 0.0), (20, 0.01), (40, 9e11), (60, 9e11))))
    assert abs(wheels.take_until(60 * MS).mean[1]) < 0.02
    assert wheels.refused["wheel_jumps"] == 1


def test_a_steering_angle_at_which_the_speed_has_no_bound_is_no_motion() -> None:
    steep = math.atan(2.83 / 0.76)
    wheels = odometry("steered", wheel_base_m=2.83, speed_wheel_offset_m=0.76)
    wheels.add(tuple(SpeedSteering(at * MS, 10.0, steep) for at in range(0, 100, 20)))
    wheels.take_until(0)
    increment = wheels.take_until(80 * MS)
    assert wheels.refused["wheel_motions"] == 1
    assert not increment.known
    assert np.array_equal(increment.mean, np.zeros(3))
    assert np.isfinite(wheels.odom_from_body.as_array()).all()


def test_a_covariance_turns_with_the_course() -> None:
    wheels = odometry("speed_yaw_rate", speed_noise_mps=0.0, yaw_rate_noise_radps=0.0, lateral_m_per_sqrt_m=0.1)
    quarter = math.pi / 2
    wheels.add((SpeedYawRate(0, 0.0, quarter / 0.4), SpeedYawRate(400 * MS, 1.0, 0.0)))
    increment = wheels.take_until(800 * MS)
    assert increment.mean == pytest.approx((0.0, 0.4, quarter), abs=1e-9)
    assert increment.covariance[0, 0] == pytest.approx(0.01 * 0.4, rel=1e-6)
    assert increment.covariance[1, 1] == pytest.approx(0.0, abs=1e-9)


def normalised_error(increment: Increment, truth: FloatArray) -> float:
    gap = increment.mean - truth
    gap[2] = wrap_rad(gap[2])
    return float(gap @ np.linalg.solve(increment.covariance, gap))


def relative(before: FloatArray, after: FloatArray) -> FloatArray:
    moved = Pose2(*before).inverse() @ Pose2(*after)
    return moved.as_array()


@pytest.mark.parametrize("scan_every", [5, 50, 1500])
def test_the_error_of_differential_drive_is_as_large_as_it_says(scan_every: int) -> None:
    """NEES of 3 between 2 and 4 (the issue's demand), over one increment of 0.1 s, of 1 s, and over a drive of 30 s."""
    settings = OdometrySettings()
    values = []
    for seed in range(12 if scan_every < 1500 else 150):
        generator = np.random.default_rng(seed)
        radius = 1.0 + settings.radius_uncertainty * generator.normal(size=2)
        tread = settings.tread_m * (1.0 + settings.tread_uncertainty * generator.normal())
        truth, true_travel, measured = np.zeros(3), np.zeros(2), [np.zeros(2)]
        poses = [truth]
        for step in range(1500):
            speed, yaw_rate = 0.5, 0.5 * math.sin(step / 200.0 + seed)
            wheel = 0.02 * np.array((speed - 0.5 * tread * yaw_rate, speed + 0.5 * tread * yaw_rate))
            true_travel = true_travel + wheel
            slip = settings.slip_m_per_sqrt_m * np.sqrt(np.abs(wheel)) * generator.normal(size=2)
            measured.append(measured[-1] + wheel / radius + slip)
            truth = arc_pose(truth, 0.02 * speed, 0.02 * yaw_rate)
            rolled = math.sqrt(0.02 * speed)
            sideways = settings.lateral_m_per_sqrt_m * rolled * generator.normal()
            turned = settings.heading_rad_per_sqrt_m * rolled * generator.normal()
            drift = np.array((-math.sin(truth[2]) * sideways, math.cos(truth[2]) * sideways, turned))
            truth = truth + drift
            poses.append(truth)
        wheels = odometry()
        wheels.add(tuple(counts(20 * k, *np.round(measured[k] / COUNT_M) * COUNT_M) for k in range(1501)))
        wheels.take_until(0)
        for first, last in pairwise(range(0, 1501, scan_every)):
            increment = wheels.take_until(last * 20 * MS)
            values.append(normalised_error(increment, relative(poses[first], poses[last])))
    assert 2.0 < np.mean(values) < 4.0


@pytest.mark.parametrize("model", ["steered", "speed_yaw_rate"])
def test_the_error_of_speed_models_is_as_large_as_it_says(model: str) -> None:
    settings = OdometrySettings.model_validate({"model": model, "noise_time_s": 0.025})
    second_noise = settings.steering_noise_rad if model == "steered" else settings.yaw_rate_noise_radps
    geometry = np.array((0.5, settings.wheel_base_m, settings.speed_wheel_offset_m, 1.0, 0.0, 1.0, 1.0))
    values = []
    for seed in range(100):
        generator = np.random.default_rng(seed)
        samples: list[WheelSample] = []
        truth = np.zeros(3)
        for step in range(40):
            speed, second = 2.0, 0.2 * math.sin(step / 10.0)
            noisy = (speed + settings.speed_noise_mps * generator.normal(), second + second_noise * generator.normal())
            stamp_ns = 25 * MS * step
            samples.append(SpeedSteering(stamp_ns, *noisy) if model == "steered" else SpeedYawRate(stamp_ns, *noisy))
            slope = math.tan(second)
            centre = speed / (1.0 - slope * geometry[2] / geometry[1]) if model == "steered" else speed
            yaw_rate = centre * slope / geometry[1] if model == "steered" else second
            truth = arc_pose(truth, 0.025 * centre, 0.025 * yaw_rate)
            rolled = math.sqrt(0.025 * centre)
            sideways = settings.lateral_m_per_sqrt_m * rolled * generator.normal()
            turned = settings.heading_rad_per_sqrt_m * rolled * generator.normal()
            drift = np.array((-math.sin(truth[2]) * sideways, math.cos(truth[2]) * sideways, turned))
            truth = truth + drift
        wheels = odometry(model, noise_time_s=0.025)
        wheels.add(tuple(samples))
        values.append(normalised_error(wheels.take_until(1000 * MS), truth))
    assert 2.0 < np.mean(values) < 4.0


def test_a_minute_without_a_scan_costs_no_more_than_a_second_and_ends_at_the_same_place() -> None:
    settings = OdometrySettings()
    blind, whole = Odometry(settings), Odometry(settings)
    for step in range(3000):
        stamp_ns = step * 20_000_000
        sample = WheelCounts(stamp_ns, 50.0 * step, 53.0 * step)
        blind.add((sample,))
        whole.add((sample,))
        if step == 0:
            blind.take_until(0)
            whole.take_until(0)
        if step % 5 == 0:
            blind.predicted(stamp_ns)
            assert len(blind._queue) <= 160
    end_ns = 2999 * 20_000_000
    predicted, expected = blind.predicted(end_ns), whole.take_until(end_ns)
    np.testing.assert_allclose(predicted.mean, expected.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(predicted.covariance, expected.covariance, rtol=1e-6, atol=1e-9)
    assert predicted.speed_mps == pytest.approx(expected.speed_mps)
    assert predicted.known is expected.known
    assert predicted.at_rest is expected.at_rest


def test_a_scan_that_comes_a_little_late_after_a_long_blindness_is_still_met_exactly() -> None:
    blind, whole = Odometry(OdometrySettings()), Odometry(OdometrySettings())
    for odometry in (blind, whole):
        odometry.add((WheelCounts(0, 0.0, 0.0),))
        odometry.take_until(0)
        odometry.add(tuple(WheelCounts(k * 20_000_000, 50.0 * k, 53.0 * k) for k in range(1, 500)))
    blind.predicted(499 * 20_000_000)
    late_ns = 499 * 20_000_000 - 300_000_000
    np.testing.assert_allclose(blind.take_until(late_ns).mean, whole.take_until(late_ns).mean, rtol=1e-9)


def gap(unbroken: bool, left_m: float, right_m: float) -> tuple[WheelCounts, ...]:
    """Silence from 20 to 1020 ms of a rover that drove 0.5 m/s before, and the first sample after it."""
    silent = tuple(counts(t, 0.01, 0.01, valid=False) for t in range(220, 1020, 100))
    return (*silent, replace(counts(1020, left_m, right_m), unbroken=unbroken))


def test_a_gap_over_which_the_counters_went_on_is_known_afterwards() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01)))
    wheels.take_until(20 * MS)
    wheels.add(gap(True, 0.31, 0.36))
    increment = wheels.take_until(1020 * MS)
    assert increment.known
    assert increment.mean[2] == pytest.approx(0.05 / 0.5)
    assert math.sqrt(increment.covariance[2, 2]) < 0.05
    assert math.sqrt(increment.covariance[0, 0]) < 0.1


def test_a_rover_that_stood_through_an_unbroken_gap_has_not_moved_at_all() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.01, 0.01), counts(20, 0.01, 0.01)))
    wheels.take_until(20 * MS)
    wheels.add(gap(True, 0.01, 0.01))
    increment = wheels.take_until(1020 * MS)
    assert increment.at_rest
    assert not increment.mean.any()
    assert not increment.covariance.any()


def test_a_broken_gap_stays_unknown() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01)))
    wheels.take_until(20 * MS)
    wheels.add(gap(False, 0.01, 0.01))
    increment = wheels.take_until(1020 * MS)
    assert not increment.known
    assert math.sqrt(increment.covariance[0, 0]) > 0.4


@given(
    scans_ms=st.lists(st.integers(21, 1019), max_size=8, unique=True).map(sorted),
    left_m=st.floats(0.0, 0.9),
    right_m=st.floats(0.0, 0.9),
)
def test_scans_within_an_unbroken_gap_leave_its_end_where_the_counters_say(
    scans_ms: list[int], left_m: float, right_m: float
) -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01)))
    wheels.take_until(20 * MS)
    samples = gap(True, left_m, right_m)
    for scan_ms in [*scans_ms, 1020]:
        wheels.add(tuple(sample for sample in samples if sample.stamp_ns <= scan_ms * MS))
        samples = tuple(sample for sample in samples if sample.stamp_ns > scan_ms * MS)
        wheels.take_until(scan_ms * MS)
    turn = (right_m - left_m) / 0.5
    assert wheels.odom_from_body.heading_rad == pytest.approx(turn, abs=1e-6)
    end = arc_pose(np.array((0.01, 0.0, 0.0)), 0.5 * (left_m + right_m) - 0.01, turn)
    away_m = math.hypot(wheels.odom_from_body.x_m - end[0], wheels.odom_from_body.y_m - end[1])
    assert away_m < 0.5 * abs(turn) + 1e-5, "on another arc between the same ends"


def test_what_a_filter_has_seen_during_a_gap_is_not_driven_twice() -> None:
    wheels = odometry()
    wheels.add((counts(0, 0.0, 0.0), counts(20, 0.01, 0.01)))
    wheels.take_until(20 * MS)
    wheels.add(gap(True, 0.51, 0.51)[:-1])
    wheels.take_until(920 * MS)
    wheels.add(gap(True, 0.51, 0.51)[-1:])
    last = wheels.take_until(1020 * MS)
    assert last.mean[0] == pytest.approx(0.05, abs=1e-5), "a tenth of the gap's way in its last tenth"
    assert wheels.odom_from_body.x_m == pytest.approx(0.51)
