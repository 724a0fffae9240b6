"""Where a sensor looked: its beams say it, or what it has reported."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Scan, Sightings, uniform_bearings
from slam.observations import NO_FEATURES, FeatureRows
from slam.settings.slam import SlamSettings
from slam.visibility import BLIND, SensorView, SightLine, in_clear_view, sight_line
from tests.slam.joint.test_gaussian import features_at

TUNING = SlamSettings().tuning()
SENSOR = (0.0, 0.0, 0.0)
NOTHING = Sightings(0, np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))


def empty_scan(spacing_rad: float) -> Scan:
    """Nothing within 80 m, in 90 degrees to either side."""
    beams = round(math.pi / spacing_rad) + 1
    return Scan(
        0, np.full(beams, np.nan, np.float32), uniform_bearings(-0.5 * math.pi, spacing_rad, beams), 0.0, 0, 80.0
    )


def is_missed(x_m: float, y_m: float, sight: SightLine) -> bool:
    return bool(in_clear_view(x_m, y_m, SENSOR, sight, TUNING))


@pytest.mark.parametrize(("spacing_deg", "near_m", "far_m"), [(1.0, 14.0, 15.0), (0.5, 28.0, 29.5), (0.25, 29.5, 31.0)])
def test_a_landmark_is_missed_where_no_post_fits_between_two_beams(
    spacing_deg: float, near_m: float, far_m: float
) -> None:
    sight = sight_line(empty_scan(math.radians(spacing_deg)))
    assert is_missed(near_m, 0.0, sight)
    assert not is_missed(far_m, 0.0, sight)


def test_a_landmark_outside_the_beams_is_not_missed() -> None:
    sight = sight_line(empty_scan(math.radians(0.5)))
    assert is_missed(1.0, 8.0, sight)
    assert not is_missed(-1.0, 8.0, sight)


def test_beams_that_do_not_increase_look_nowhere() -> None:
    folded = Scan(0, np.full(3, 5.0, np.float32), np.array((0.5, 0.0, -0.5)), 0.0)
    assert sight_line(folded) is BLIND


def room_scan(empty_beams: int, dark_beams: int) -> Scan:
    """Walls at 12 m and nothing in the first beams; a chair at 2 m, and beams that its dark part has swallowed."""
    ranges = np.full(361, 12.0, np.float32)
    ranges[:empty_beams] = np.nan
    ranges[170:180] = 2.0
    ranges[180 : 180 + dark_beams] = np.nan
    return Scan(0, ranges, uniform_bearings(-0.5 * math.pi, math.radians(0.5), 361), 0.0, 0, 80.0)


@pytest.mark.parametrize(("empty_beams", "is_open"), [(0, False), (120, True)])
def test_what_swallows_beams_between_walls_hides_what_lies_behind_it(empty_beams: int, is_open: bool) -> None:
    view = SensorView(0.1)
    for _ in range(3):
        sight = view.of(room_scan(empty_beams, 20), NO_FEATURES)
    behind = math.radians(5.0)
    assert is_missed(8.0 * math.cos(behind), 8.0 * math.sin(behind), sight) == is_open
    beside = math.radians(40.0)
    assert is_missed(8.0 * math.cos(beside), 8.0 * math.sin(beside), sight), "a return from behind says so"


def test_single_beams_that_are_lost_between_walls_hide_nothing() -> None:
    view, scan = SensorView(0.1), room_scan(0, 0)
    scan = replace(scan, ranges_m=np.where(np.arange(361) % 20 == 0, np.nan, scan.ranges_m).astype(np.float32))
    lost_beam = math.radians(-90.0 + 0.5 * 240)
    assert is_missed(8.0 * math.cos(lost_beam), 8.0 * math.sin(lost_beam), view.of(scan, NO_FEATURES))


def reports(*points: tuple[float, float]) -> FeatureRows:
    return features_at(list(points))


def test_a_sensor_that_reports_things_looks_as_far_and_as_wide_as_it_has_reported() -> None:
    view = SensorView(0.1)
    assert not is_missed(3.0, 0.0, view.of(NOTHING, NO_FEATURES)), "it has shown nothing of where it looks"
    view.of(NOTHING, reports((10.0, 0.0), (4.0, 4.0), (4.0, -4.0)))
    sight = view.of(NOTHING, NO_FEATURES)
    assert is_missed(8.0, 1.0, sight)
    assert not is_missed(9.5, 0.0, sight)
    assert not is_missed(1.0, 4.0, sight)


def test_a_miss_says_as_much_as_the_sensor_usually_finds() -> None:
    rare, sure = SensorView(0.1), SensorView(0.1)
    for _ in range(200):
        rare.learn(1, 4)
        sure.learn(9, 1)
    seen = reports((10.0, 0.0))
    assert rare.of(NOTHING, seen).certainty < 0.15
    assert sure.of(NOTHING, seen).certainty == 1.0
