import numpy as np
import pytest

from drivers.measurements import SpeedSteering, WheelCounts
from runtime.calibrate.drive_data import DriveData, SteeringStart, WheelSeries
from runtime.calibrate.wheel_model import DifferentialModel, SteeredModel
from slam.odometry.odometry import Odometry
from slam.settings.odometry import OdometrySettings
from tests.support.runtime.made_drives import START, Rover, counted, weaving, wheel_counts, wheel_travel_m

EXACT = Rover(slip=0.0)


def _series(duration_s: float = 20.0) -> WheelSeries:
    path = weaving(duration_s)
    counts = counted(wheel_travel_m(path, 0.5), EXACT, np.random.default_rng(1))
    return DriveData("made", (), wheel_counts(path.times_s, counts)).wheel_series()


def test_dead_reckoning_is_the_filters_own() -> None:
    series = _series()
    settings = OdometrySettings(wheel_radius_left_m=0.12, wheel_radius_right_m=0.13, tread_m=0.45)
    odometry = Odometry(settings)
    stamps = [round(time * 1e9) for time in series.times_s]
    odometry.add(tuple(WheelCounts(stamp, *pair) for stamp, pair in zip(stamps, series.values.tolist(), strict=True)))
    odometry.take_until(stamps[0])
    for stamp in stamps[1:]:
        odometry.take_until(stamp)
    model = DifferentialModel(START)
    values = model.start.copy()
    values[:3] = 0.12, 0.13, 0.45
    pose = model.dead_reckoning(series, values).poses[-1]
    expected = odometry.odom_from_body
    np.testing.assert_allclose(pose[:2], (expected.x_m, expected.y_m), atol=1e-6)


def test_steered_dead_reckoning_is_the_filters_own() -> None:
    samples = [SpeedSteering(i * 25_000_000, 2.0 + 0.01 * i, 0.3 * np.sin(0.05 * i)) for i in range(200)]
    settings = OdometrySettings(model="steered", steering_scale=1.05, steering_bias_rad=0.01)
    odometry = Odometry(settings)
    odometry.add(tuple(samples))
    for sample in samples:
        odometry.take_until(sample.stamp_ns)
    model = SteeredModel(SteeringStart(steering_scale=1.05, steering_bias_rad=0.01))
    pose = model.dead_reckoning(DriveData("made", (), tuple(samples)).wheel_series(), model.start).poses[-1]
    expected = odometry.odom_from_body
    np.testing.assert_allclose(pose[:2], (expected.x_m, expected.y_m), atol=1e-6)


def test_slip_that_is_taken_back_leaves_the_true_travel() -> None:
    series, model = _series(), DifferentialModel(START)
    spans = np.array(((3.0, 5.0), (5.0, 8.0), (10.0, 12.0)))
    slips = np.array(((0.02, -0.01), (0.0, 0.03), (-0.02, 0.01)))
    cleaned = model.without_errors(series, model.start, spans, slips)
    metres_per_count = 2.0 * np.pi * 0.125 / 4096.0
    taken = (series.values - cleaned.values) * metres_per_count
    at = [int(np.searchsorted(series.times_s, time)) for time in (2.5, 5.0, 9.0, 12.5)]
    np.testing.assert_allclose(taken[at], ((0.0, 0.0), (0.02, -0.01), (0.02, 0.02), (0.0, 0.03)), atol=2e-4)


@pytest.mark.parametrize("lost", ["invalid", "late"])
def test_silence_of_a_wheel_breaks_the_series(lost: str) -> None:
    samples = [WheelCounts(i * 20_000_000, float(i), float(i), not (lost == "invalid" and i == 5)) for i in range(10)]
    if lost == "late":
        samples = [WheelCounts(s.stamp_ns + 600_000_000 * (i >= 6), s.left, s.right) for i, s in enumerate(samples)]
    series = DriveData("made", (), tuple(samples)).wheel_series()
    after = 5 if lost == "invalid" else 6
    assert series.broken.nonzero()[0].tolist() == [after]


def test_samples_that_go_back_in_time_or_are_not_numbers_are_left_out() -> None:
    samples = (WheelCounts(0, 0, 0), WheelCounts(2, 1, 1), WheelCounts(1, 5, 5), WheelCounts(3, float("nan"), 2))
    assert len(DriveData("made", (), samples).wheel_series().times_s) == 2
