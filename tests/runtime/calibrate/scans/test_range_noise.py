import numpy as np
import pytest

from drivers.measurements import Scan, WheelCounts, uniform_bearings
from runtime.calibrate.drive_data import DriveData
from runtime.calibrate.scans.range_noise import range_noise, standstills

BEARINGS = uniform_bearings(-1.0, 0.01, 200)


def _drive(sigma_m: float, rest_s: float, rng: np.random.Generator) -> DriveData:
    """At rest, then driving; a tenth of the beams sees leaves, two thirds once someone who walks by."""
    scans = []
    for number in range(60):
        ranges = 5.0 + np.arange(200) * 0.01 + sigma_m * rng.standard_normal(200)
        ranges[:20] += rng.exponential(0.08, 20)
        ranges[20:150] -= 2.0 * ((np.arange(20, 150) - 20) // 6 == number)
        ranges[30 + number] = np.nan
        scans.append(Scan(number * 100_000_000, ranges.astype(np.float32), BEARINGS))
    wheels = []
    for number in range(320):
        rolled = max(0.0, number * 0.02 - rest_s) * 1000.0
        wheels.append(WheelCounts(number * 20_000_000, rolled, rolled))
    return DriveData("made", tuple(scans), tuple(wheels))


def test_noise_of_a_range_is_found_at_standstill_in_spite_of_leaves_and_walkers() -> None:
    inside = 0
    for seed in range(20):
        noise = range_noise([_drive(0.02, 3.0, np.random.default_rng(seed))])
        assert noise.sigma_m is not None
        assert abs(noise.sigma_m / 0.02 - 1.0) < 0.05
        inside += noise.low_m <= 0.02 <= noise.high_m
    assert inside >= 16


def test_without_standstill_nothing_is_said() -> None:
    noise = range_noise([_drive(0.02, 0.0, np.random.default_rng(1))])
    assert noise.sigma_m is None


def test_standstill_ends_before_the_wheels_turn() -> None:
    drive = _drive(0.02, 3.0, np.random.default_rng(1))
    assert [drive.scans[end - 1].stamp_ns * 1e-9 for _, end in standstills(drive)] == pytest.approx([2.7])
