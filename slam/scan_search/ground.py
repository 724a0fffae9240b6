"""What the views of a map say of the ground: where something stands, where nothing does, and where a rover can be."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.arithmetic.functions import lengths
from slam.compiled import kernel
from slam.maps.occupancy_grid import FREE, OCCUPIED, GridMap, OccupancyArray, OccupancyGrid
from slam.maps.views import Views
from slam.pose import Pose2

CELL_M = 0.15
MOST_CELLS = 4_000_000  # 32 MB while it is made; what lies beyond them is not looked at
FINE_CELLS, COARSE_CELLS = 1, 2  # so near to something a return counts as one of it
STEP_CELLS = 3  # between positions that are tried
NEAR_M = 2.5  # a rover comes back as near as this to where one was

CellArray = NDArray[np.int32]


class Ground(NamedTuple):
    """fine, coarse (rows, columns): 1 where a return is expected, -1 in the open, 0 where nothing is known. places
    (D, 2): rows and columns of positions that are tried. x_m, y_m: the lower left corner of the first cell.
    """

    fine: OccupancyArray
    coarse: OccupancyArray
    places: CellArray
    x_m: float
    y_m: float

    def near(self, x_m: float, y_m: float, radius_m: float) -> "Ground":
        """The same with the positions within a radius of a point."""
        rows, columns = (self.places.T + 0.5) * CELL_M
        distances = lengths(np.column_stack((self.x_m + columns - x_m, self.y_m + rows - y_m)))
        return self._replace(places=np.ascontiguousarray(self.places[distances <= radius_m]))


class Plan:
    """The ground as views show it, made in slices. ground: None until it is finished."""

    def __init__(self, views: Views) -> None:
        self._views = views
        self._grid = OccupancyGrid(CELL_M, MOST_CELLS)
        self._last_steps = self._finish()
        self.added = 0
        self.ground: Ground | None = None

    def advance(self, most_views: int) -> bool:
        """Add so many views at most, or take one of the last steps; True when it is finished."""
        if self.added == len(self._views):
            next(self._last_steps, None)
            return self.ground is not None
        last = min(self.added + most_views, len(self._views))
        for number in range(self.added, last):
            pose, points = self._views.poses[number], self._views.points_m(number)
            ends = Pose2(*pose.tolist()).transform(points)
            try:
                self._grid.add(pose[:2], ends, np.ones(len(ends), dtype=np.bool_))
            except MemoryError:
                continue
        self.added = last
        return False

    def _finish(self) -> Iterator[None]:
        """Each step takes some ms for the largest grid."""
        grid = self._grid.grid_map()
        yield
        fine = expected(grid.occupancy, FINE_CELLS)
        yield
        coarse = expected(grid.occupancy, COARSE_CELLS)
        yield
        self.ground = Ground(fine, coarse, _places(grid, self._views.poses), *grid.origin_m)
        del self._grid


def ground_of(views: Views) -> Ground:
    """At once."""
    plan = Plan(views)
    while not plan.advance(len(views)):
        pass
    assert plan.ground is not None
    return plan.ground


def _places(grid: GridMap, poses: FloatArray) -> CellArray:
    """(D, 2) the middle of every block of STEP_CELLS in which something is free, near to one of the poses (K, 3)."""
    near = np.zeros(grid.occupancy.shape, dtype=np.bool_)
    reach = round(NEAR_M / CELL_M)
    for column, row in np.floor((poses[:, :2] - grid.origin_m) / CELL_M).astype(np.int64).tolist():
        near[max(row - reach, 0) : max(row + reach + 1, 0), max(column - reach, 0) : max(column + reach + 1, 0)] = True
    free = near & (grid.occupancy == FREE)
    rows, columns = -(-np.array(free.shape) // STEP_CELLS)
    whole = np.zeros((STEP_CELLS * rows, STEP_CELLS * columns), dtype=np.bool_)
    whole[: free.shape[0], : free.shape[1]] = free
    blocks = whole.reshape(rows, STEP_CELLS, columns, STEP_CELLS).any(axis=(1, 3))
    return (STEP_CELLS * np.argwhere(blocks) + STEP_CELLS // 2).astype(np.int32)


@kernel
def expected(occupancy: OccupancyArray, reach: int) -> OccupancyArray:
    """1 within reach cells of what is occupied, else -1 where it is free, else 0."""
    rows, columns = occupancy.shape
    values = np.zeros(occupancy.shape, dtype=np.int8)
    for row in range(rows):
        for column in range(columns):
            if occupancy[row, column] == FREE and values[row, column] == 0:
                values[row, column] = -1
            elif occupancy[row, column] == OCCUPIED:
                for other in range(max(row - reach, 0), min(row + reach + 1, rows)):
                    for across in range(max(column - reach, 0), min(column + reach + 1, columns)):
                        values[other, across] = 1
    return values
