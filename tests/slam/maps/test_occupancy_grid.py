"""Walls are occupied, what was seen through is free, and whoever walked through is not in the map."""

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, GridMap, OccupancyGrid

RESOLUTION_M = 0.1
PLENTY = 10_000_000


def cell(grid: GridMap, x_m: float, y_m: float) -> int:
    column, row = np.floor((np.array((x_m, y_m)) - grid.origin_m) / grid.resolution_m + 1e-9).astype(int)
    return int(grid.occupancy[row, column])


def wall(x_m: float = 5.03) -> FloatArray:
    return np.column_stack((np.full(81, x_m), np.linspace(-2.0, 2.0, 81)))


def standing_before(sensor_m: FloatArray, ends_m: FloatArray, scans: int, grid: OccupancyGrid) -> None:
    for _ in range(scans):
        grid.add(sensor_m, ends_m, np.ones(len(ends_m), dtype=np.bool_))


def test_a_wall_is_occupied_the_way_to_it_free_and_what_lies_behind_unknown() -> None:
    grid = OccupancyGrid(RESOLUTION_M, PLENTY)
    standing_before(np.zeros(2), wall(), 3, grid)
    standing_before(
        np.array((9.0, 4.0)), wall() + np.array((0.0, 3.0)), 1, grid
    )  # so that the map reaches beyond the wall
    seen = grid.grid_map()
    assert [cell(seen, 5.03, y) for y in (-1.75, 0.05, 1.75)] == [OCCUPIED] * 3
    assert [cell(seen, x, 0.05) for x in (0.05, 2.05, 4.85)] == [FREE] * 3
    assert cell(seen, 6.05, 0.05) == UNKNOWN


@pytest.mark.parametrize("walker_first", [True, False])
def test_whoever_walked_through_is_not_in_the_map_whenever_he_came(walker_first: bool) -> None:
    grid = OccupancyGrid(RESOLUTION_M, PLENTY)
    with_walker = wall()
    with_walker[38:43] *= 2.53 / 5.03
    turns = [(with_walker, 5), (wall(), 15)]
    for ends_m, scans in turns if walker_first else turns[::-1]:
        standing_before(np.zeros(2), ends_m, scans, grid)
    seen = grid.grid_map()
    assert cell(seen, 2.53, 0.05) == FREE
    assert cell(seen, 5.03, 0.05) == OCCUPIED


def test_what_the_front_end_saw_moving_is_never_occupied_but_shows_what_lies_before_it() -> None:
    grid = OccupancyGrid(RESOLUTION_M, PLENTY)
    ends = wall()
    moving = np.zeros(len(ends), dtype=np.bool_)
    moving[30:50] = True
    grid.add(np.zeros(2), ends, ~moving)
    seen = grid.grid_map()
    assert cell(seen, 5.03, 0.05) == UNKNOWN
    assert cell(seen, 4.05, 0.05) == FREE
    assert cell(seen, 5.03, -1.95) == OCCUPIED


def test_a_grid_that_grows_keeps_what_it_has_counted() -> None:
    grid, again = OccupancyGrid(RESOLUTION_M, PLENTY), OccupancyGrid(RESOLUTION_M, PLENTY)
    places = [np.zeros(2), np.array((-60.0, 45.0)), np.array((70.0, -40.0))]
    for place in places:
        standing_before(place, wall() + place, 2, grid)
    for place in places[::-1]:
        standing_before(place, wall() + place, 2, again)
    first, second = grid.grid_map(), again.grid_map()
    assert first.origin_m == second.origin_m == pytest.approx((-60.0, -42.0))
    assert np.array_equal(first.occupancy, second.occupancy)
    assert [cell(first, 5.03 + x, y) for x, y in places] == [OCCUPIED] * 3


def test_a_grid_larger_than_allowed_is_refused_and_an_empty_one_is_a_grid() -> None:
    grid = OccupancyGrid(RESOLUTION_M, 1_000_000)
    assert grid.grid_map().occupancy.size == 0
    standing_before(np.zeros(2), wall(), 1, grid)
    before = grid.grid_map().occupancy
    with pytest.raises(MemoryError, match="million cells"):
        standing_before(np.zeros(2), wall(500.0), 1, grid)
    assert np.array_equal(grid.grid_map().occupancy, before)


def test_rays_of_every_direction_stay_inside_and_free_the_line_between() -> None:
    grid = OccupancyGrid(RESOLUTION_M, PLENTY)
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    ends = 3.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    standing_before(np.zeros(2), ends, 1, grid)
    seen = grid.grid_map()
    for angle in angles:
        assert cell(seen, 2.0 * np.cos(angle), 2.0 * np.sin(angle)) == FREE
