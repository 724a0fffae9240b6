import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import FloatArray, Scan, uniform_bearings
from slam.front_end import corners as corner_module
from slam.front_end.corners import corners
from slam.front_end.deskew import Twist, deskew
from slam.front_end.trunks import holes_in, runs_of_beams
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from tests.support.examples import examples

SPACING = math.radians(0.25)
BEARINGS = uniform_bearings(-math.radians(120.0), SPACING, 961)
SETTINGS = FrontEndSettings(sigma_range_m=0.01)


def cast(walls: list[tuple[tuple[float, float], tuple[float, float]]]) -> FloatArray:
    """Exact ranges to walls from the origin."""
    ranges = np.full(BEARINGS.shape, np.inf)
    for (x, y), (to_x, to_y) in walls:
        span_x, span_y = to_x - x, to_y - y
        cross = np.cos(BEARINGS) * span_y - np.sin(BEARINGS) * span_x
        cross = np.where(cross == 0.0, 1e-12, cross)
        distance = (x * span_y - y * span_x) / cross
        along = (x * np.sin(BEARINGS) - y * np.cos(BEARINGS)) / cross
        ranges = np.where((distance > 0) & (along >= 0) & (along <= 1), np.minimum(ranges, distance), ranges)
    return ranges


def found(ranges: FloatArray, settings: FrontEndSettings = SETTINGS) -> tuple[FloatArray, FloatArray]:
    """Points (c, 2) and rows (c, 8)."""
    scan = Scan(0, ranges.astype(np.float32), BEARINGS, range_max_m=60.0)
    beams = deskew(scan, Twist(), Pose2(), 0.1, 60.0)
    holes = holes_in(beams)
    rows = corners(beams, runs_of_beams(beams, holes), settings, holes)
    return np.stack((rows[:, 0] * np.cos(rows[:, 1]), rows[:, 0] * np.sin(rows[:, 1])), axis=-1), rows


@examples(60)
@given(st.integers(0, 2**31), st.floats(2.0, 6.0), st.floats(-1.2, 1.2), st.floats(-0.4, 0.4))
def test_the_corner_of_two_noisy_walls_is_found_within_its_own_covariance(
    seed: int, distance: float, bearing: float, turn: float
) -> None:
    corner = np.array((distance * math.cos(bearing), distance * math.sin(bearing)))
    ends = []
    for side in (-1.0, 1.0):
        angle = bearing + turn + math.pi + side * math.radians(50.0)
        ends.append(corner + 1.2 * np.array((math.cos(angle), math.sin(angle))))
    walls = [((e[0], e[1]), (corner[0], corner[1])) for e in ends]
    exact = cast(walls)
    noisy = exact + 0.01 * np.random.default_rng(seed).standard_normal(exact.shape)
    points, rows = found(noisy)
    bends = rows[:, 7] == 0
    assert bends.sum() == 1
    assert np.hypot(*(points[bends][0] - corner)) < 0.08
    error = rows[bends][0, :2] - (distance, bearing)
    covariance = np.array(((rows[bends][0, 2], rows[bends][0, 3]), (rows[bends][0, 3], rows[bends][0, 4])))
    assert error @ np.linalg.solve(covariance, error) < 16.0


def test_the_free_end_of_a_wall_is_a_feature_and_an_end_that_something_hides_is_none() -> None:
    wall = cast([((3.0, -1.0), (3.0, 1.0))])
    points, rows = found(wall)
    assert (rows[:, 7] == 1).all()
    np.testing.assert_allclose(np.sort(points[:, 1]), (-1.0, 1.0), atol=0.02)
    np.testing.assert_allclose(points[:, 0], 3.0, atol=0.02)
    hidden = cast([((3.0, -1.0), (3.0, 1.0)), ((1.5, 0.4), (1.5, 0.8))])
    left = found(hidden)[0]
    on_wall = left[left[:, 0] > 2.5]
    assert len(on_wall) == 1
    assert abs(on_wall[0, 1] + 1.0) < 0.02


def test_the_covariance_of_a_corner_is_what_its_two_lines_leave_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mean 2 would be exact; 1.2, because slanting beams carry only a part of their noise across a wall."""
    monkeypatch.setattr(corner_module, "SIGMA_CORNER_M", 0.0)
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(150):
        distance, bearing = rng.uniform(2.0, 6.0), rng.uniform(-1.2, 1.2)
        corner = np.array((distance * math.cos(bearing), distance * math.sin(bearing)))
        walls = []
        for angle, length in ((bearing + 2.2, 0.7), (bearing - 2.4, 1.6)):
            end = corner + length * np.array((math.cos(angle), math.sin(angle)))
            walls.append(((end[0], end[1]), (corner[0], corner[1])))
        exact = cast(walls)
        _, rows = found(exact + 0.01 * rng.standard_normal(exact.shape), SETTINGS)
        for row in rows[rows[:, 7] == 0]:
            covariance = np.array(((row[2], row[3]), (row[3], row[4])))
            error = row[:2] - (distance, bearing)
            squares.append(error @ np.linalg.solve(covariance, error))
    assert len(squares) > 130
    assert 0.8 < np.mean(np.sort(squares)[:-3]) < 2.5


def test_the_end_of_a_wall_is_used_only_where_its_beams_lie_close() -> None:
    near, _ = found(cast([((1.0, 0.8), (3.0, 0.8))]))
    assert np.hypot(*(near - (3.0, 0.8)).T).min() < 0.03
    far, _ = found(cast([((1.0, 0.8), (5.2, 0.8))]))
    assert np.hypot(*(far - (5.2, 0.8)).T).min() > 1.0


def test_a_wall_that_fades_out_of_sight_at_grazing_incidence_has_no_end() -> None:
    points, _ = found(cast([((-1.0, 0.8), (40.0, 0.8))]))
    assert not np.any(points[:, 0] > 5.0)


def test_a_straight_wall_and_a_ring_have_no_corner() -> None:
    _, rows = found(cast([((4.0, -3.0), (4.0, 3.0))]))
    assert not np.any(rows[:, 7] == 0)
    _, rows = found(np.full(BEARINGS.shape, 5.0))
    assert not np.any(rows[:, 7] == 0)


def test_a_long_wall_of_which_half_the_beams_are_dropped_has_no_ends() -> None:
    wall = cast([((-12.0, 4.0), (20.0, 4.0))])
    generator = np.random.default_rng(4)
    _, whole = found(wall)
    for share in (0.05, 0.2, 0.5):
        counts = [len(found(np.where(generator.random(len(wall)) < share, np.inf, wall))[1]) for _ in range(10)]
        assert np.mean(counts) <= len(whole) + 0.5


def test_every_covariance_is_positive_definite() -> None:
    room = cast([((3.0, -2.0), (3.0, 2.0)), ((3.0, 2.0), (-1.0, 2.0)), ((3.0, -2.0), (-1.0, -2.0))])
    _, rows = found(room + 0.01 * np.random.default_rng(3).standard_normal(room.shape))
    assert len(rows) >= 2
    assert (rows[:, 2] > 0).all()
    assert (rows[:, 2] * rows[:, 4] > rows[:, 3] ** 2).all()
