"""A map prepared for recognition: its landmarks by place, and its pairs of landmarks by length.

It grows with the map: `follow` brings it up to date with a bounded number of changes a call, and what results is what
an index made at once would be.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.functions import lengths
from slam.recognise.grid import Grid, make_grid, neighbours
from slam.recognise.scale import Scale

LONGEST_M = 30.0  # of a pair of landmarks; shortened where the map would have more pairs than MOST_PAIRS
SHORTER = 0.8
MOST_PAIRS = 1_500_000
MOST_COMING = 500_000  # pairs that are found before they are sorted in: all of a crowded map would fill the memory
CROWD_M = 12.0  # radius within which the density around a landmark is counted
CELL_M = 10.0  # of the area that the map covers: cells with a landmark and those around them
MOVED_SHARE = 0.25  # of the scale's sigma: a landmark that the filter has moved by more is indexed anew
FIRST_ROOM = 256
FREE = -1


class MapPairs(NamedTuple):
    """Pairs of landmarks, the shortest first: lengths_m (P,), rows of both ends (P,), single precision."""

    lengths_m: NDArray[np.float32]
    first: NDArray[np.int32]
    second: NDArray[np.int32]


class IndexedMap(NamedTuple):
    """What an attempt searches in; never changed again.

    identities (R,) of the landmarks, -1 where a row is free; densities (R,) of landmarks around each, 1/m^2; area_m2
    that the map covers.
    """

    identities: IntArray
    grid: Grid
    pairs: MapPairs
    densities: FloatArray
    area_m2: float


class MapIndex:
    """Follows a map. scale: how exact its landmarks are."""

    def __init__(self, scale: Scale) -> None:
        self.scale = scale
        self._longest_m = LONGEST_M
        self._free = list(range(FIRST_ROOM))[::-1]
        self._identities = np.full(FIRST_ROOM, FREE, dtype=np.int64)
        self._points = np.zeros((FIRST_ROOM, 2))
        self._crowds = np.zeros(FIRST_ROOM, dtype=np.int64)
        self._covered: dict[tuple[int, int], int] = {}
        none = np.empty(0, dtype=np.int32)
        self._pairs = MapPairs(np.empty(0, dtype=np.float32), none, none)
        self._indexed: IndexedMap | None = None

    def __len__(self) -> int:
        return len(self._identities) - len(self._free)

    def follow(self, identities: IntArray, means_m: FloatArray, most_changes: int | None = None) -> bool:
        """Bring the index up to date with the landmarks (L,), (L, 2) of a map; False where changes are left over.

        most_changes: landmarks that are added or taken out in this call, None for all.
        """
        order = np.argsort(self._identities, kind="stable")
        names = self._identities[order]
        found = np.searchsorted(names, identities, side="right") - 1
        known = np.where(names[found] == identities, order[found], FREE)
        apart = lengths(self._points[known] - means_m)
        moved = (known != FREE) & (apart > MOVED_SHARE * self.scale.sigma_m)
        gone = self._identities != FREE
        gone[known[(known != FREE) & ~moved]] = False
        leaving, coming = np.flatnonzero(gone), np.flatnonzero((known == FREE) | moved)
        self._leave(leaving[:most_changes])
        if len(leaving[:most_changes]) < len(leaving):
            return False
        self._come(identities[coming[:most_changes]], means_m[coming[:most_changes]])
        return len(coming[:most_changes]) == len(coming)

    @property
    def indexed(self) -> IndexedMap:
        """The map as it is now."""
        if self._indexed is None:
            points, used = self._points.copy(), self._identities != FREE
            densities = (1 + self._crowds) / (math.pi * CROWD_M * CROWD_M)
            grid = make_grid(points, used, self.scale.widest_gate_m)
            area = len(self._covered) * CELL_M * CELL_M
            self._indexed = IndexedMap(self._identities.copy(), grid, self._pairs, densities, area)
        return self._indexed

    def _leave(self, rows: IntArray) -> None:
        if not len(rows):
            return
        self._indexed = None
        leaving = np.zeros(len(self._identities), dtype=np.bool_)
        leaving[rows] = True
        self._pairs = _only(self._pairs, ~(leaving[self._pairs.first] | leaving[self._pairs.second]))
        for row in rows.tolist():
            used = self._identities != FREE
            neighbours(self._points, used, row, 0.0, 0.0, CROWD_M, self._crowds, -1)
            self._cover(row, -1)
            self._identities[row] = FREE
            self._free.append(row)

    def _come(self, identities: IntArray, means_m: FloatArray) -> None:
        if not len(identities):
            return
        self._indexed = None
        lengths, first, second, found = [], [], [], 0
        for identity, mean in zip(identities.tolist(), means_m, strict=True):
            if not self._free:
                self._enlarge()
            row = self._free.pop()
            self._points[row] = mean
            used = self._identities != FREE
            others, distances, self._crowds[row] = neighbours(
                self._points, used, row, self.scale.shortest_pair_m, self._longest_m, CROWD_M, self._crowds, 1
            )
            self._identities[row] = identity
            self._cover(row, 1)
            lengths.append(distances)
            first.append(np.full(len(others), row))
            second.append(others)
            found += len(others)
            if found >= MOST_COMING:
                self._sort_in(np.concatenate(lengths), np.concatenate(first), np.concatenate(second))
                lengths, first, second, found = [], [], [], 0
        if lengths:
            self._sort_in(np.concatenate(lengths), np.concatenate(first), np.concatenate(second))

    def _sort_in(self, lengths_m: FloatArray, first: IntArray, second: IntArray) -> None:
        """Add pairs (p,), and leave out the longest of all while there are too many."""
        self._pairs = _merged(self._pairs, lengths_m, first, second)
        while len(self._pairs.lengths_m) > MOST_PAIRS:
            self._longest_m *= SHORTER
            self._pairs = _only(self._pairs, self._pairs.lengths_m <= self._longest_m)

    def _cover(self, row: int, by: int) -> None:
        """Count a landmark in its cell of CELL_M and those around it."""
        column, line = (math.floor(value / CELL_M) for value in self._points[row].tolist())
        for cell in ((column + i, line + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            count = self._covered.get(cell, 0) + by
            if count:
                self._covered[cell] = count
            else:
                del self._covered[cell]

    def _enlarge(self) -> None:
        before = len(self._identities)
        self._identities = np.concatenate((self._identities, np.full(before, FREE)))
        self._points = np.concatenate((self._points, np.zeros((before, 2))))
        self._crowds = np.concatenate((self._crowds, np.zeros(before, dtype=np.int64)))
        self._free += range(2 * before - 1, before - 1, -1)


def index_of(scale: Scale, identities: IntArray, means_m: FloatArray) -> MapIndex:
    """The index of landmarks (L,), (L, 2), made at once."""
    index = MapIndex(scale)
    index.follow(identities, means_m)
    return index


def _only(pairs: MapPairs, kept: BoolArray) -> MapPairs:
    return MapPairs(pairs.lengths_m[kept], pairs.first[kept], pairs.second[kept])


def _merged(pairs: MapPairs, lengths_m: FloatArray, first: IntArray, second: IntArray) -> MapPairs:
    """More pairs, sorted in."""
    order = np.argsort(lengths_m, kind="stable")
    lengths = lengths_m[order].astype(np.float32)
    at = np.searchsorted(pairs.lengths_m, lengths, side="right")
    return MapPairs(
        np.insert(pairs.lengths_m, at, lengths),
        np.insert(pairs.first, at, first[order].astype(np.int32)),
        np.insert(pairs.second, at, second[order].astype(np.int32)),
    )
