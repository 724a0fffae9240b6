"""A laser that sees all round may begin to count its beams anywhere, and its last beam lies beside its first."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from drivers.simulated.world.places.building import Building, building_settings
from runtime.studies.places.building_drive import building_ticks
from runtime.tick import Tick
from slam.angles import beams_after_first, sees_all_round
from slam.estimator import Estimator
from slam.front_end.alignment_kernels import nearest_in_scan, surface_normals
from slam.front_end.deskew import Twist, deskew
from slam.front_end.differencing import CompensatedVote, PlacedScan
from slam.front_end.wide_search import compare
from slam.observations import BeamVerdict
from slam.pose import Pose2
from slam.settings.slam import SlamSettings
from slam.visibility import in_clear_view, is_in_sight, sight_line

BEAMS, SPACING_RAD = 360, math.radians(1.0)
FIRST_RAD = (-math.pi, -math.radians(89.0), 0.0, math.radians(250.0))
MOUNT_X_M, UNTIL_S = 0.3, 8.0
SENSOR = (0.0, 0.0, 0.0)
TUNING = SlamSettings().tuning()


def room(first_rad: float, heading_rad: float = 0.0) -> Scan:
    """Seen from the middle of a room of 8 by 6 metres."""
    bearings_rad = uniform_bearings(first_rad, SPACING_RAD, BEAMS)
    towards_rad = bearings_rad + heading_rad
    with np.errstate(divide="ignore"):
        ranges_m = np.minimum(4.0 / np.abs(np.cos(towards_rad)), 3.0 / np.abs(np.sin(towards_rad)))
    return Scan(0, ranges_m.astype(np.float32), bearings_rad, range_max_m=12.0)


def begun_at(scan: Scan, first_rad: float) -> Scan:
    """The same beams, counted from another one."""
    skipped = round((first_rad - scan.bearings_rad[0]) / SPACING_RAD)
    ranges_m = np.roll(scan.ranges_m, -skipped)
    return Scan(scan.stamp_ns, ranges_m, uniform_bearings(first_rad, SPACING_RAD, BEAMS), 0.0, 0, scan.range_max_m)


def ticks_from(first_rad: float) -> Iterator[Tick]:
    for tick in building_ticks(Building(building_settings(1, BEAMS)), 10.0):
        if tick.stamp_ns * 1e-9 > UNTIL_S:
            return
        scan = tick.scan
        yield replace(tick, scan=begun_at(scan, first_rad)) if isinstance(scan, Scan) else tick


@pytest.mark.parametrize("first_rad", FIRST_RAD)
def test_a_bearing_is_found_wherever_beams_are_counted_from(first_rad: float) -> None:
    bearings_rad = uniform_bearings(first_rad, SPACING_RAD, BEAMS)
    for turn_rad in (-2.0 * math.pi, 0.0, 2.0 * math.pi):
        found = [round(beams_after_first(b + turn_rad, first_rad, SPACING_RAD, BEAMS)) for b in bearings_rad]
        assert found == list(range(BEAMS))


def test_a_laser_with_a_gap_behind_has_nothing_there() -> None:
    beams, first_rad = 271, math.radians(-135.0)
    assert not sees_all_round(SPACING_RAD, beams)
    assert beams_after_first(math.radians(-136.0), first_rad, SPACING_RAD, beams) == pytest.approx(-1.0)
    assert beams_after_first(math.radians(136.0), first_rad, SPACING_RAD, beams) == pytest.approx(271.0)
    assert beams_after_first(math.radians(226.0), first_rad, SPACING_RAD, beams) == pytest.approx(1.0)


@pytest.mark.parametrize("first_rad", FIRST_RAD)
@pytest.mark.parametrize("bearing_deg", range(-180, 181, 20))
def test_what_stands_in_any_direction_is_in_sight(first_rad: float, bearing_deg: int) -> None:
    sight = sight_line(room(first_rad))
    x_m, y_m = 2.0 * math.cos(math.radians(bearing_deg)), 2.0 * math.sin(math.radians(bearing_deg))
    assert in_clear_view(x_m, y_m, SENSOR, sight, TUNING)
    assert is_in_sight(x_m, y_m, SENSOR, sight, TUNING)
    assert not is_in_sight(3.0 * x_m, 3.0 * y_m, SENSOR, sight, TUNING)


@pytest.mark.parametrize("first_rad", FIRST_RAD)
def test_every_point_finds_its_surface(first_rad: float) -> None:
    beams = deskew(room(first_rad), Twist(), Pose2(), 0.1, 12.0)
    normals = np.empty_like(beams.points_m)
    surface_normals(beams.points_m, SPACING_RAD, normals)
    whole = room(-math.pi)
    same = np.array([round(beams_after_first(b, first_rad, SPACING_RAD, BEAMS)) for b in whole.bearings_rad])
    expected = np.empty_like(normals)
    surface_normals(beams.points_m[same], SPACING_RAD, expected)
    np.testing.assert_allclose(np.abs(normals[same]), np.abs(expected), atol=1e-6)
    off_m, to_side = 0.97, SPACING_RAD * 0.45
    for beam in range(BEAMS):
        if np.isnan(normals[beam, 0]):
            continue
        bearing_rad, range_m = beams.bearings_rad[beam] + to_side, off_m * beams.ranges_m[beam]
        x_m, y_m = range_m * math.cos(bearing_rad), range_m * math.sin(bearing_rad)
        at, _ = nearest_in_scan(x_m, y_m, first_rad, SPACING_RAD, beams.points_m, normals, 0.3)
        assert at >= 0
    points_m, pose = beams.points_m, np.array((0.02, -0.03, 0.01))
    same_count, free = compare(points_m, pose, points_m, first_rad, SPACING_RAD)
    assert (same_count, free) == (BEAMS, 0)
    last_alone = np.full_like(points_m, np.nan)
    last_alone[-1] = points_m[-1]
    assert tuple(compare(points_m[:1], np.zeros(3), last_alone, first_rad, SPACING_RAD)) == (1, 0)


@pytest.mark.parametrize("first_rad", FIRST_RAD)
def test_bearings_of_a_moving_laser_do_not_jump_between_beams(first_rad: float) -> None:
    timed = Scan(0, room(first_rad).ranges_m, room(first_rad).bearings_rad, 1e-4, 180, 12.0)
    beams = deskew(timed, Twist(0.5, 0.0, 0.3), Pose2(), 0.1, 12.0)
    assert np.abs(np.diff(beams.bearings_rad)).max() < 3.0 * SPACING_RAD


@pytest.mark.parametrize("first_rad", FIRST_RAD)
@pytest.mark.parametrize("turned_rad", [0.5, -0.5])
def test_every_beam_of_a_rover_that_turned_is_found_again(first_rad: float, turned_rad: float) -> None:
    vote, nothing = CompensatedVote(), np.zeros((0, 2))
    for number in range(5):
        before = replace(room(first_rad), stamp_ns=number * 100_000_000)
        vote.ask(PlacedScan(deskew(before, Twist(), Pose2(), 0.1, 12.0), nothing, Pose2()))
    turned = replace(room(first_rad, turned_rad), stamp_ns=900_000_000)
    asked = vote.ask(PlacedScan(deskew(turned, Twist(), Pose2(), 0.1, 12.0), nothing, Pose2(0.0, 0.0, turned_rad)))
    assert asked.voters > 1
    assert (asked.verdicts == BeamVerdict.KEPT).all()


def test_where_beams_are_counted_from_makes_no_difference_to_a_drive() -> None:
    settings = SlamSettings.model_validate({"mount": {"x_m": MOUNT_X_M}, "particles": 10})
    ends, fits = [], []
    for first_rad in FIRST_RAD:
        estimator = Estimator(settings, 1)
        for tick in ticks_from(first_rad):
            estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        ends.append(estimate.map_from_body.as_array())
        fits.append(estimate.counts["keyframe_fits"])
    assert min(fits) > 0.9 * max(fits) > 10.0
    assert np.ptp(ends, axis=0)[:2].max() < 0.05
    assert np.ptp(ends, axis=0)[2] < 0.02
