"""All landmarks of the joint Gaussian: those in its state, and those far away that hang on neighbours.

Every landmark owns one row of the atlas as long as it lives. Memory grows with the map, the work of a step does not.
"""

import math
from copy import copy

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.joint.window import ORPHAN, ancestors_first, settle

PARENTS = 4
FREE, AWAY = -2, -1
FIRST_ROOM = 256
ENLARGED_BY_ZEROS = (
    "identities",
    "log_odds",
    "looks",
    "finds",
    "missed",
    "frozen",
    "means",
    "covariances",
    "parent_means",
    "weights",
    "residuals",
    "_carries",
)


class Atlas:
    """Columns over rows (R,).

    place: where in the state vector the landmark stands, AWAY outside it, FREE for an unused row.
    looks, finds, missed: see slam.joint.evidence.DetectionRates. frozen: of a saved map that must stay as it is.
    means (R, 2), covariances (R, 2, 2): as they were when the landmark left the state.
    parents (R, 4) rows it hangs on (ORPHAN: none), parent_means (R, 8) when it was written so, weights (R, 2, 8),
    residuals (R, 2, 2).
    """

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._cells: dict[tuple[int, int], tuple[int, ...]] = {}
        self._cell_of: dict[int, tuple[int, int]] = {}
        self._free: list[int] = []
        self.identities = np.zeros(0, dtype=np.int64)
        self.log_odds = np.zeros(0)
        self.looks = np.zeros(0)
        self.finds = np.zeros(0)
        self.missed = np.zeros(0, dtype=np.bool_)
        self.frozen = np.zeros(0, dtype=np.bool_)
        self.place = np.zeros(0, dtype=np.int64)
        self.means = np.zeros((0, 2))
        self.covariances = np.zeros((0, 2, 2))
        self.parents = np.zeros((0, PARENTS), dtype=np.int64)
        self.parent_means = np.zeros((0, 2 * PARENTS))
        self.weights = np.zeros((0, 2, 2 * PARENTS))
        self.residuals = np.zeros((0, 2, 2))
        self._carries = np.zeros(0, dtype=np.bool_)
        self._enlarge(FIRST_ROOM)

    def copied(self) -> "Atlas":
        """A copy that shares nothing."""
        other = copy(self)
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray):
                setattr(other, name, column.copy())
        other._cells, other._cell_of, other._free = self._cells.copy(), self._cell_of.copy(), self._free.copy()
        return other

    @property
    def count(self) -> int:
        """Landmarks in all."""
        return len(self.place) - len(self._free)

    def add(self, identity: int, log_odds: float, place: int) -> int:
        """Row of a new landmark in the state."""
        if not self._free:
            self._enlarge(len(self.place))
        row = self._free.pop()
        self.identities[row], self.log_odds[row], self.place[row] = identity, log_odds, place
        self.looks[row] = self.finds[row] = self.missed[row] = self.frozen[row] = 0
        self.parents[row], self._carries[row] = ORPHAN, False
        return row

    def add_away(self, identity: int, log_odds: float, mean_m: FloatArray, covariance_m2: FloatArray) -> None:
        """A landmark outside the state that hangs on nothing."""
        row = self.add(identity, log_odds, AWAY)
        self.means[row], self.covariances[row] = mean_m, covariance_m2
        self.put_away(row)

    def holding(self, identity: int, rows: IntArray) -> IntArray:
        """Those of some rows, of this atlas or of a younger one, that hold this identity."""
        rows = rows[rows < len(self.identities)]
        held: IntArray = rows[self.identities[rows] == identity]
        return held

    def remove(self, row: int) -> None:
        """Forget a landmark of the state; what hangs on it stands alone from then on."""
        if self._carries[row]:
            children = np.flatnonzero((self.parents == row).any(axis=1))
            self.parents[children] = ORPHAN
        self.place[row] = FREE
        self._free.append(row)

    def put_away(self, row: int) -> None:
        """The landmark has left the state; its columns are filled in."""
        self.place[row] = AWAY
        self._carries[self.parents[row][self.parents[row] >= 0]] = True
        x, y = self.means[row] / self._cell_m
        self._sort_in(row, (math.floor(x), math.floor(y)))

    def take_back(self, row: int, place: int) -> None:
        """The landmark is in the state again."""
        cell = self._cell_of.pop(row)
        left = tuple(other for other in self._cells.pop(cell) if other != row)
        if left:
            self._cells[cell] = left
        self.place[row] = place

    def away_near(self, x_m: float, y_m: float, radius_m: float) -> list[int]:
        """Rows outside the state in cells that touch a square around a point, in a fixed order."""
        low_x, high_x = math.floor((x_m - radius_m) / self._cell_m), math.floor((x_m + radius_m) / self._cell_m)
        low_y, high_y = math.floor((y_m - radius_m) / self._cell_m), math.floor((y_m + radius_m) / self._cell_m)
        found: list[int] = []
        for i in range(low_x, high_x + 1):
            for j in range(low_y, high_y + 1):
                found += self._cells.get((i, j), ())
        return found

    def with_ancestors(self, rows: list[int]) -> list[int]:
        """Rows outside the state with all outside it that they hang on, every landmark after its parents."""
        order: list[int] = ancestors_first(np.array(rows, dtype=np.int64), self.place == AWAY, self.parents).tolist()
        return order

    def settled_means(self, state_rows: IntArray, state_means_m: FloatArray) -> FloatArray:
        """(R, 2) means of all rows as they follow from those in the state now; nothing is changed."""
        return self.settled(state_rows, state_means_m)[0]

    def sort_anew(self, state_rows: IntArray, state_means_m: FloatArray) -> None:
        """After the map has moved: settle everything outside the state and sort it into cells by where it is now."""
        self.means, self.parent_means = self.settled(state_rows, state_means_m)
        rows = np.flatnonzero(self.place == AWAY)
        self._cells, self._cell_of = {}, {}
        cells = np.floor(self.means[rows] / self._cell_m).astype(np.int64)
        for row, (i, j) in zip(rows.tolist(), cells.tolist(), strict=True):
            self._sort_in(row, (i, j))

    def settled(self, state_rows: IntArray, state_means_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, and (R, 8) those of the landmarks that each hangs on."""
        means, parent_means = self.means.copy(), self.parent_means.copy()
        means[state_rows] = state_means_m
        known = self.place != AWAY
        settle(np.flatnonzero(~known), known, means, self.parents, parent_means, self.weights)
        return means, parent_means

    def _sort_in(self, row: int, cell: tuple[int, int]) -> None:
        self._cells[cell] = (*self._cells.get(cell, ()), row)  # never changed in place: copies share them
        self._cell_of[row] = cell

    def _enlarge(self, by: int) -> None:
        before = len(self.place)
        for name in ENLARGED_BY_ZEROS:
            column = getattr(self, name)
            setattr(self, name, np.concatenate((column, np.zeros((by, *column.shape[1:]), dtype=column.dtype))))
        self.place = np.concatenate((self.place, np.full(by, FREE, dtype=np.int64)))
        self.parents = np.concatenate((self.parents, np.full((by, PARENTS), ORPHAN, dtype=np.int64)))
        self._free += range(before + by - 1, before - 1, -1)
