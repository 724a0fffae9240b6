"""An occupancy grid by ray casting: of every cell, how often a beam ended in it and how often one went through.

Counts instead of a running log-odds: their sum does not depend on the order of the scans, and someone who stands for a
while is outvoted by all who looked through that place before and after.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray
from slam.compiled import kernel

HIT_LOG_ODDS = 0.85  # of 70 % and 40 %, as in Hornung et al. 2013 (OctoMap)
PASS_LOG_ODDS = -0.41
SHORT_M = 0.1  # a beam says nothing of the last bit before its end: three deviations of the range
UNKNOWN, FREE, OCCUPIED = -1, 0, 100  # as nav_msgs/OccupancyGrid has them
MARGIN_M = 20.0  # more room than was asked for, so that the grid is not enlarged in every scan
MOST_COUNTED = 60_000  # in uint16

CountArray = NDArray[np.uint16]
OccupancyArray = NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class GridMap:
    """What is known of every cell.

    occupancy (rows, columns): UNKNOWN, FREE or OCCUPIED; row 0 is the lowest y. origin_m: x, y of the lower left corner
    of the first cell in the map frame.
    """

    occupancy: OccupancyArray
    origin_m: tuple[float, float]
    resolution_m: float


class OccupancyGrid:
    """Grows with what is seen; memory is 8 bytes a cell."""

    def __init__(self, resolution_m: float, most_cells: int) -> None:
        self.resolution_m = resolution_m
        self.scans = 0
        self._most_cells = most_cells
        self._low = np.zeros(2, dtype=np.int64)  # cell of the map frame that stands first in the arrays
        self._hits = np.zeros((0, 0), dtype=np.uint16)
        self._passes = np.zeros((0, 0), dtype=np.uint16)
        self._counted = np.zeros((0, 0), dtype=np.int32)  # number of the last scan that counted here

    def add(self, sensor_m: FloatArray, points_m: FloatArray, solid: BoolArray) -> None:
        """Count one scan: rays from sensor_m (2,) to points_m (n, 2), map frame; no row may hold NaN.

        solid (n,): where the beam ended at something that stays. Other beams show only what lies before it. Every cell
        counts once in a scan, and a hit outweighs the beams that graze it. Raises MemoryError beyond most_cells.
        """
        if len(points_m) == 0:
            return
        cells = np.vstack((sensor_m, points_m)) / self.resolution_m
        self._cover(np.floor(cells.min(axis=0)).astype(np.int64), np.floor(cells.max(axis=0)).astype(np.int64))
        self.scans += 1
        cast_rays(
            cells - self._low, SHORT_M / self.resolution_m, solid, self.scans, self._hits, self._passes, self._counted
        )

    def grid_map(self) -> GridMap:
        """The part of the grid that was seen, decided cell by cell."""
        seen = self._counted > 0
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        if rows.size == 0:
            return GridMap(np.zeros((0, 0), dtype=np.int8), (0.0, 0.0), self.resolution_m)
        window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        origin = (self._low + np.array((columns[0], rows[0]))) * self.resolution_m
        occupancy = decide(self._hits[window], self._passes[window])
        return GridMap(occupancy, (float(origin[0]), float(origin[1])), self.resolution_m)

    def _cover(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        """Enlarge the arrays until they hold the cells from low to high (2,), x first."""
        size = np.array(self._hits.shape[::-1])
        if (low >= self._low).all() and (high < self._low + size).all():
            return
        margin = math.ceil(MARGIN_M / self.resolution_m)
        new_low, new_high = low - margin, high + margin
        if size.all():
            new_low = np.where(low < self._low, new_low, self._low)
            new_high = np.where(high >= self._low + size, new_high, self._low + size - 1)
        columns, rows = (new_high - new_low + 1).tolist()
        if rows * columns > self._most_cells:
            raise MemoryError(f"{rows * columns / 1e6:.0f} million cells")
        at_column, at_row = (self._low - new_low if size.all() else np.zeros(2, dtype=np.int64)).tolist()
        for name in ("_hits", "_passes", "_counted"):
            old = getattr(self, name)
            new = np.zeros((rows, columns), dtype=old.dtype)
            new[at_row : at_row + old.shape[0], at_column : at_column + old.shape[1]] = old
            setattr(self, name, new)
        self._low = new_low


@kernel
def decide(hits: CountArray, passes: CountArray) -> OccupancyArray:
    """UNKNOWN where no scan looked, else what the log-odds of all of them say."""
    occupancy = np.full(hits.shape, UNKNOWN, dtype=np.int8)
    for row in range(hits.shape[0]):
        for column in range(hits.shape[1]):
            if hits[row, column] or passes[row, column]:
                log_odds = HIT_LOG_ODDS * hits[row, column] + PASS_LOG_ODDS * passes[row, column]
                occupancy[row, column] = OCCUPIED if log_odds > 0.0 else FREE
    return occupancy


@kernel
def cast_rays(
    cells: FloatArray,
    short: float,
    solid: BoolArray,
    number: int,
    hits: CountArray,
    passes: CountArray,
    counted: NDArray[np.int32],
) -> None:
    """Count one scan, the number-th, in place. cells (1 + n, 2): x, y of the sensor and of the ends, in cells.
    short: how many cells before its end a beam stops to say that a place is free.
    """
    for index in range(solid.size):
        column, row = int(cells[1 + index, 0]), int(cells[1 + index, 1])
        if solid[index] and counted[row, column] != number:
            counted[row, column] = number
            hits[row, column] = min(hits[row, column] + 1, MOST_COUNTED)
    for index in range(solid.size):
        column, row = int(cells[0, 0]), int(cells[0, 1])
        dx, dy = cells[1 + index, 0] - cells[0, 0], cells[1 + index, 1] - cells[0, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length <= short:
            continue
        dx, dy = dx * (1.0 - short / length), dy * (1.0 - short / length)
        last_column, last_row = int(cells[0, 0] + dx), int(cells[0, 1] + dy)
        right, up = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # shares of the ray at which it enters the next column and the next row (Amanatides and Woo 1987)
        each_column, each_row = (1.0 / abs(dx) if dx else math.inf), (1.0 / abs(dy) if dy else math.inf)
        in_column, in_row = cells[0, 0] - column, cells[0, 1] - row
        next_column = each_column * (1.0 - in_column if right > 0 else in_column) if dx else math.inf
        next_row = each_row * (1.0 - in_row if up > 0 else in_row) if dy else math.inf
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            if counted[row, column] != number:
                counted[row, column] = number
                passes[row, column] = min(passes[row, column] + 1, MOST_COUNTED)
            if next_column < next_row:
                column += right
                next_column += each_column
            else:
                row += up
                next_row += each_row
