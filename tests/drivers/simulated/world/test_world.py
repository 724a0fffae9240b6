import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, WorldSettings
from drivers.simulated.world.places.world import Surface, World
from drivers.simulated.world.ray_casting import circle_hits, pairs_in_view
from tests.support.examples import examples

EXACT = LaserGeometrySettings(sigma_range_m=0.0, drop_out_share=0.0, mixed_share=0.0)
WORLD = World(WorldSettings())
SECOND_NS = 1_000_000_000


def test_two_worlds_of_the_same_settings_agree_bit_for_bit_in_any_order_of_asking() -> None:
    other = World(WorldSettings())
    times = [0, 7 * SECOND_NS, 3 * SECOND_NS + 1]
    first = {t: WORLD.ranges_at(t) for t in times}
    second = {t: other.ranges_at(t) for t in reversed(times)}
    for t in times:
        assert first[t].tobytes() == second[t].tobytes()
        assert WORLD.map_from_body(t) == other.map_from_body(t)
        assert WORLD.wheel_travel_m(t) == other.wheel_travel_m(t)


def test_another_seed_is_another_park_and_another_noise() -> None:
    other = World(WorldSettings(seed=2))
    assert not np.array_equal(other.landmarks().positions_m, WORLD.landmarks().positions_m)
    assert not np.array_equal(WORLD.ranges_at(0), WORLD.ranges_at(1))


def test_the_rover_rests_at_the_origin_for_two_seconds_and_then_reaches_its_speed() -> None:
    assert WORLD.map_from_body(0) == (0.0, 0.0, 0.0)
    assert WORLD.map_from_body(2 * SECOND_NS) == (0.0, 0.0, 0.0)
    assert WORLD.wheel_travel_m(2 * SECOND_NS) == (0.0, 0.0)
    one, two = WORLD.wheel_travel_m(5 * SECOND_NS), WORLD.wheel_travel_m(6 * SECOND_NS)
    assert sum(two) / 2 - sum(one) / 2 == pytest.approx(0.5)


@examples(40)
@given(st.floats(0.0, 3600.0))
def test_driving_the_wheel_travel_from_one_true_pose_arrives_at_the_next(time_s: float) -> None:
    """Midpoint rule over 10 ms: an error of the third order in a turn of some milliradians."""
    begin, end = int(time_s * 1e9), int(time_s * 1e9) + 10_000_000
    x, y, heading = WORLD.map_from_body(begin)
    travel = np.subtract(WORLD.wheel_travel_m(end), WORLD.wheel_travel_m(begin))
    distance, turn = travel.mean(), (travel[1] - travel[0]) / 0.5
    expected = (
        x + distance * math.cos(heading + 0.5 * turn),
        y + distance * math.sin(heading + 0.5 * turn),
        heading + turn,
    )
    assert WORLD.map_from_body(end) == pytest.approx(expected, abs=1e-7)


def test_a_lap_closes_and_the_next_one_is_the_same() -> None:
    course = World(WorldSettings()).path.course
    arc = np.linspace(0.0, course.length_m, 50)
    np.testing.assert_allclose(course.points_m(arc + 3 * course.length_m), course.points_m(arc), atol=1e-7)
    assert course.lap_turn_rad == pytest.approx(2.0 * math.pi)
    heading = course.heading_rad(np.linspace(0.0, course.length_m, 20_000))
    curvature = np.diff(heading) / (course.length_m / 19_999)
    assert curvature.max() > 0.5 > 0.0 > -0.2 > curvature.min(), "the course turns both ways"
    assert np.abs(np.diff(curvature)).max() < 0.02, "no jump in curvature"


def test_a_beam_on_a_post_measures_the_distance_to_its_skin_from_where_the_laser_was_then() -> None:
    world = World(WorldSettings(laser=EXACT, people=0, bushes=0))
    laser, true = world.settings.laser, world.landmarks()
    start = 20 * SECOND_NS
    sweep = world.sweep_at(start)
    beams = np.flatnonzero(sweep.landmarks >= 0)
    assert beams.size > 20
    for beam in beams:
        x, y, heading = world.map_from_body(start + round(beam * laser.beam_period_s * 1e9))
        angle = heading + laser.first_bearing_rad + beam * laser.beam_spacing_rad
        hit = np.array((x + 0.3 * math.cos(heading), y + 0.3 * math.sin(heading)))
        hit += sweep.ranges_m[beam] * np.array((math.cos(angle), math.sin(angle)))
        landmark = sweep.landmarks[beam]
        from_centre = np.hypot(*(hit - true.positions_m[landmark]))
        assert from_centre == pytest.approx(true.radii_m[landmark], abs=1e-6)


def test_what_the_rover_does_during_a_sweep_is_seen_in_the_sweep() -> None:
    still = EXACT.model_copy(update={"revolution_s": 1e-9})
    moving, frozen = World(WorldSettings(laser=EXACT)), World(WorldSettings().model_copy(update={"laser": still}))
    t = 9 * SECOND_NS
    swept, at_once = moving.ranges_at(t), frozen.ranges_at(t)
    both = np.isfinite(swept) & np.isfinite(at_once)
    shift = np.abs(swept[both] - at_once[both])
    assert shift[:20].max(initial=0.0) < 0.01
    assert np.median(shift[-100:]) > 0.005


def test_everything_that_stands_in_the_park_is_seen_from_the_course_and_nothing_stands_on_it() -> None:
    course = WORLD.path.course
    path = course.points_m(np.linspace(0.0, course.length_m, 400))
    true = WORLD.landmarks()
    gaps = np.hypot(*(path[:, None] - true.positions_m).transpose(2, 0, 1)) - true.radii_m
    assert gaps.min() > WORLD.settings.clearance_m - 0.01
    seen = [set(WORLD.sweep_at(t * SECOND_NS).landmarks) - {-1} for t in range(0, 60, 4)]
    assert min(len(s) for s in seen) >= 8
    assert len(set().union(*seen)) >= 0.9 * len(true.radii_m)
    surfaces = np.bincount(np.concatenate([WORLD.sweep_at(t * SECOND_NS).surfaces for t in range(0, 60, 6)]))
    assert (surfaces[[Surface.POLE, Surface.TREE, Surface.BUSH, Surface.WALL, Surface.PERSON]] > 30).all()


def test_people_walk_and_give_way_to_the_rover() -> None:
    times = np.arange(0.0, 120.0, 0.25)
    rover, _ = WORLD.path.poses(times)
    circles = WORLD._people.circles_m(times, rover)
    gap = np.hypot(*(circles - rover[:, None]).transpose(2, 0, 1)) - WORLD._people.radii_m
    assert gap.min() > 0.5
    middle = 0.5 * (circles[:, :7] + circles[:, 7:])
    speed = np.hypot(*np.diff(middle, axis=0).transpose(2, 0, 1)) / 0.25
    assert (np.median(speed, axis=0) > 0.5).sum() >= 5
    assert (speed[: 4 * 7, 2::3] < 1e-9).all(), "every third stands at first"


def test_noise_and_drop_outs_have_the_size_that_was_asked_for() -> None:
    noisy = World(WorldSettings(laser=LaserGeometrySettings(sigma_range_m=0.02, drop_out_share=0.05, mixed_share=0.0)))
    exact = World(WorldSettings(laser=EXACT))
    walls, lost, hits = [], 0, 0
    for t in range(0, 30 * SECOND_NS, SECOND_NS):
        a, b = noisy.sweep_at(t), exact.sweep_at(t)
        wall = (a.surfaces == Surface.WALL) & (b.surfaces == Surface.WALL)
        walls.append(a.ranges_m[wall] - b.ranges_m[wall])
        fixed = np.isfinite(b.ranges_m) & (b.surfaces != Surface.BUSH)
        hits, lost = hits + fixed.sum(), lost + (~np.isfinite(a.ranges_m[fixed])).sum()
    assert np.std(np.concatenate(walls)) == pytest.approx(0.02, rel=0.1)
    assert lost / hits == pytest.approx(0.05, abs=0.01)


def test_nothing_is_measured_beyond_the_range_of_the_laser() -> None:
    short = World(WorldSettings(laser=LaserGeometrySettings(range_max_m=5.0)))
    ranges = short.ranges_at(0)
    assert np.isinf(ranges).any()
    assert ranges[np.isfinite(ranges)].max() <= 5.0


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_a_course_of_any_size_and_speed_closes(scale: float) -> None:
    world = World(WorldSettings(drive=DriveSettings(course_scale=scale, speed_mps=1.9), poles=3, trees=3))
    x, y, _ = world.map_from_body(600 * SECOND_NS)
    assert math.hypot(x, y) < 12 * scale
    assert world.ranges_at(600 * SECOND_NS).shape == (1081,)


def test_a_course_whose_corners_fall_together_is_refused_with_the_key() -> None:
    drive = DriveSettings(corners_m=((1.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    with pytest.raises(ValueError, match="corners_m"):
        World(WorldSettings(drive=drive))
    with pytest.raises(ValidationError, match="speed_mps"):
        DriveSettings(speed_mps=5.0)


@examples(50)
@given(st.integers(0, 2**31), st.floats(-6.0, 6.0))
def test_no_ray_that_meets_a_circle_is_left_out_wherever_the_circles_and_the_blind_sector_are(
    seed: int, heading: float
) -> None:
    rng = np.random.default_rng(seed)
    centres, radii = rng.uniform(-8.0, 8.0, (12, 2)), rng.uniform(0.03, 1.0, 12)
    bearings = np.linspace(heading - 2.3, heading + 2.3, 301)
    directions = np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)
    rays, circles = np.divmod(np.arange(301 * 12), 12)
    entry, _ = circle_hits(np.zeros((rays.size, 2)), directions[rays], centres[circles], radii[circles])
    meeting = set(zip(rays[np.isfinite(entry)].tolist(), circles[np.isfinite(entry)].tolist(), strict=True))
    half = np.arcsin(np.minimum(radii / np.hypot(*centres.T), 1.0))
    aimed = np.arctan2(centres[:, 1], centres[:, 0]) + 2.0 * np.pi * np.round(heading / (2.0 * np.pi))
    kept = set(zip(*(side.tolist() for side in pairs_in_view(bearings, aimed, half + 0.01)), strict=True))
    assert meeting <= kept
