import numpy as np
import pytest

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import LaserGeometrySettings, WorldSettings
from drivers.simulated.world.places.building import Building, building_settings
from drivers.simulated.world.places.world import LabelledSweep, Surface
from drivers.simulated.world.ray_casting import segments_met, wall_hits

SECOND_NS = 1_000_000_000
NOISELESS = {"sigma_range_m": 0.0, "drop_out_share": 0.0, "mixed_share": 0.0}
BUILDING = Building(building_settings(1))


def noiseless(seed: int, people: int = 0) -> Building:
    settings = building_settings(seed, people=people)
    laser = LaserGeometrySettings.model_validate({**settings.laser.model_dump(), **NOISELESS})
    return Building(WorldSettings.model_validate({**settings.model_dump(), "laser": laser}))


def points_of(building: Building, sweep: LabelledSweep, start_ns: int) -> FloatArray:
    """(n, 2) in the map, each from the pose of its own beam."""
    laser = building.settings.laser
    steps = np.arange(laser.beam_count, dtype=np.float64)
    body, heading = building.path.poses(start_ns * 1e-9 + laser.beam_period_s * steps)
    angle = heading + laser.first_bearing_rad + laser.beam_spacing_rad * steps
    mount = laser.body_from_laser[0] * np.column_stack((np.cos(heading), np.sin(heading)))
    ranges = np.where(np.isfinite(sweep.ranges_m), sweep.ranges_m, np.nan)
    beam = ranges[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    points: FloatArray = body + mount + beam
    return points


def distances_to_segments(points_m: FloatArray, starts_m: FloatArray, ends_m: FloatArray) -> FloatArray:
    span = ends_m - starts_m
    offset = points_m[:, None] - starts_m
    share = np.clip((offset * span).sum(axis=-1) / (span**2).sum(axis=-1), 0.0, 1.0)
    distances: FloatArray = np.hypot(*(offset - share[..., None] * span).transpose(2, 0, 1)).min(axis=1)
    return distances


def test_a_seed_is_a_building_and_another_seed_another_one() -> None:
    again, other = Building(building_settings(1)), Building(building_settings(2))
    for start_ns in (90 * SECOND_NS, 3 * SECOND_NS):
        assert again.sweep_at(start_ns).ranges_m.tobytes() == BUILDING.sweep_at(start_ns).ranges_m.tobytes()
    assert not np.array_equal(other.floor.doors.opened(0.0), BUILDING.floor.doors.opened(0.0))


def test_the_loop_is_150_m_long_and_nothing_stands_in_its_way() -> None:
    assert BUILDING.path.course.length_m == pytest.approx(150.0, abs=1.0)
    path = BUILDING.path.course.points_m(np.arange(0.0, 150.0, 0.1))
    for seed in range(5):
        floor = Building(building_settings(seed)).floor
        assert distances_to_segments(path, floor.starts_m, floor.ends_m).min() > 0.6
        assert (np.hypot(*(path[:, None] - floor.circles_m).transpose(2, 0, 1)) - floor.radii_m).min() > 0.6


def test_a_wall_is_measured_where_it_stands_whichever_way_the_laser_moves_meanwhile() -> None:
    building = noiseless(3)
    for start_ns in range(2 * SECOND_NS, 200 * SECOND_NS, 23 * SECOND_NS):
        sweep = building.sweep_at(start_ns)
        on_wall = sweep.surfaces == Surface.WALL
        assert on_wall.sum() > 200
        points = points_of(building, sweep, start_ns)[on_wall]
        assert distances_to_segments(points, building.floor.starts_m, building.floor.ends_m).max() < 1e-6


def test_the_nearest_of_all_segments_is_hit_as_if_every_pair_were_tried() -> None:
    rng = np.random.default_rng(4)
    angle = np.linspace(-2.3, 2.3, 541)
    origins = np.linspace((0.0, 0.0), (0.06, 0.02), 541)
    directions = np.column_stack((np.cos(angle), np.sin(angle)))
    for _ in range(20):
        starts = rng.uniform(-15.0, 15.0, (60, 2))
        ends = starts + rng.uniform(-4.0, 4.0, (60, 2))
        distances, _, rays, _ = segments_met(origins, directions, starts, ends, 10.0)
        nearest = np.full(541, np.inf)
        np.minimum.at(nearest, rays, distances)
        expected = wall_hits(origins, directions, starts, ends).min(axis=1)
        within = expected < 10.0
        np.testing.assert_allclose(nearest[within], expected[within])


def test_doors_open_and_close_while_others_stay() -> None:
    opened = np.array([BUILDING.floor.doors.opened(time_s) for time_s in np.arange(0.0, 240.0, 0.25)])
    ever_moved = np.ptp(opened, axis=0) > 0.0
    assert 0.1 < ever_moved.mean() < 0.6
    assert (opened[:, ever_moved].max(axis=0) == 1.0).all()
    assert {0.0, 1.0} <= set(opened[0, ~ever_moved])
    hinges, edges = BUILDING.floor.doors.leaves_m(17.0)
    np.testing.assert_allclose(np.hypot(*(edges - hinges).T), 0.9)


def test_glass_is_seen_from_the_front_only_and_beams_pass_through_it_or_do_not_come_back() -> None:
    seen, behind, nothing = 0, 0, 0
    for seed in range(2):
        building = noiseless(seed)
        glass = building.floor.glass
        for start_ns in range(2 * SECOND_NS, 210 * SECOND_NS, 5 * SECOND_NS):
            sweep = building.sweep_at(start_ns)
            x, y, heading = building.map_from_body(start_ns + SECOND_NS // 20)
            laser = building.settings.laser
            angle = heading + laser.first_bearing_rad + laser.beam_spacing_rad * np.arange(laser.beam_count)
            origins = np.tile((x + 0.3 * np.cos(heading), y + 0.3 * np.sin(heading)), (len(angle), 1))
            directions = np.column_stack((np.cos(angle), np.sin(angle)))
            solid, panes = (
                wall_hits(origins, directions, building.floor.starts_m[kind], building.floor.ends_m[kind]).min(axis=1)
                for kind in (~glass, glass)
            )
            first = panes < solid - 0.3
            seen += int((sweep.surfaces[first] == Surface.GLASS).sum())
            behind += int((np.isfinite(sweep.ranges_m[first]) & (sweep.ranges_m[first] > panes[first] + 0.2)).sum())
            nothing += int(np.isinf(sweep.ranges_m[first]).sum())
    whole = seen + behind + nothing
    assert min(seen, behind, nothing) > 0.05 * whole > 50


def test_people_walk_within_the_corridor_and_are_seen() -> None:
    building = noiseless(1, people=12)
    shares = []
    for start_ns in range(0, 210 * SECOND_NS, 5 * SECOND_NS):
        sweep = building.sweep_at(start_ns)
        on_people = sweep.surfaces == Surface.PERSON
        shares.append(on_people.mean())
        path = building.path.course.points_m(np.arange(0.0, 150.0, 0.1))
        for point in points_of(building, sweep, start_ns)[on_people][::9]:
            assert np.hypot(*(path - point).T).min() < 1.3
    assert 0.005 < np.mean(shares) < 0.2
