"""Points of a map by place: which one is nearest to here, and how thick do they stand."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import inlined, kernel, leaf

BUCKETS_PER_POINT = 4
BITS_PER_POINT = 128
PATCHES_PER_GATE = 2
NONE = -1


class Grid(NamedTuple):
    """Rows of points_m (R, 2) sorted by the hash of their cell, which costs the same however wide the map is.

    starts (B + 1,): where in rows (n,) each bucket begins, B a power of two. cell_m: edge of a cell and widest gate.
    occupied (C,): a bit for each patch of patch_m, by its hash, that a point lies within the widest gate of. Most
    places have none nearby, and are told so by one read.
    """

    points_m: FloatArray
    starts: IntArray
    rows: IntArray
    cell_m: float
    occupied: NDArray[np.uint8]
    patch_m: float


@inlined
def bucket_of(column: int, row: int, buckets: int) -> int:
    """Bucket of a cell."""
    mixed = (column * 73856093) ^ (row * 19349663)
    return (mixed ^ (mixed >> 15)) & (buckets - 1)


@kernel
def make_grid(points_m: FloatArray, used: BoolArray, cell_m: float) -> Grid:
    """The used (R,) rows of points_m (R, 2)."""
    count = int(used.sum())
    buckets = 16
    while buckets < BUCKETS_PER_POINT * count:
        buckets *= 2
    bits = buckets * (BITS_PER_POINT // BUCKETS_PER_POINT)
    occupied, patch_m = np.zeros(bits // 8, dtype=np.uint8), cell_m / PATCHES_PER_GATE
    starts, rows = np.zeros(buckets + 1, dtype=np.int64), np.empty(count, dtype=np.int64)
    of = np.empty(used.size, dtype=np.int64)
    for row in range(used.size):
        if used[row]:
            of[row] = bucket_of(math.floor(points_m[row, 0] / cell_m), math.floor(points_m[row, 1] / cell_m), buckets)
            starts[of[row] + 1] += 1
            mark(points_m[row, 0], points_m[row, 1], cell_m, patch_m, occupied)
    for bucket in range(buckets):
        starts[bucket + 1] += starts[bucket]
    filled = starts[:-1].copy()
    for row in range(used.size):
        if used[row]:
            rows[filled[of[row]]] = row
            filled[of[row]] += 1
    return Grid(points_m, starts, rows, cell_m, occupied, patch_m)


@leaf
def mark(x: float, y: float, gate_m: float, patch_m: float, occupied: NDArray[np.uint8]) -> None:
    """Set the bits of all patches that have a place within a gate of a point."""
    bits = 8 * occupied.size
    for column in range(math.floor((x - gate_m) / patch_m), math.floor((x + gate_m) / patch_m) + 1):
        for row in range(math.floor((y - gate_m) / patch_m), math.floor((y + gate_m) / patch_m) + 1):
            dx = max(abs(x - (column + 0.5) * patch_m) - 0.5 * patch_m, 0.0)
            dy = max(abs(y - (row + 0.5) * patch_m) - 0.5 * patch_m, 0.0)
            if dx * dx + dy * dy <= gate_m * gate_m:
                bit = bucket_of(column, row, bits)
                occupied[bit >> 3] |= np.uint8(1 << (bit & 7))


@inlined
def is_empty(occupied: NDArray[np.uint8], per_metre: float, x: float, y: float) -> bool:
    """True where no point lies within the widest gate; per_metre is 1 / patch_m."""
    bit = bucket_of(math.floor(x * per_metre), math.floor(y * per_metre), 8 * occupied.size)
    return bool((occupied[bit >> 3] >> (bit & 7)) & 1 == 0)


@leaf
def nearest(grid: Grid, x: float, y: float, gate_m: float) -> tuple[int, float]:
    """Row of the nearest point within a gate, NONE where there is none, and its squared distance."""
    best, best_square = NONE, gate_m * gate_m
    buckets = grid.starts.size - 1
    for column in range(math.floor((x - gate_m) / grid.cell_m), math.floor((x + gate_m) / grid.cell_m) + 1):
        for row in range(math.floor((y - gate_m) / grid.cell_m), math.floor((y + gate_m) / grid.cell_m) + 1):
            bucket = bucket_of(column, row, buckets)
            for at in range(grid.starts[bucket], grid.starts[bucket + 1]):
                point = grid.rows[at]
                dx, dy = grid.points_m[point, 0] - x, grid.points_m[point, 1] - y
                square = dx * dx + dy * dy
                if square < best_square:
                    best, best_square = point, square
    return best, best_square


@kernel
def neighbours(
    points_m: FloatArray,
    used: BoolArray,
    row: int,
    least_m: float,
    most_m: float,
    crowd_m: float,
    crowds: IntArray,
    by: int,
) -> tuple[IntArray, FloatArray, int]:
    """Of the used rows other than this: those least_m to most_m away, their distances, and how many are within crowd_m,
    to whose crowds (R,) `by` is added.
    """
    count, crowd = 0, 0
    found, distances = np.empty(8, dtype=np.int64), np.empty(8)
    x, y, reach_m = points_m[row, 0], points_m[row, 1], max(most_m, crowd_m)
    for other in range(used.size):
        dx, dy = points_m[other, 0] - x, points_m[other, 1] - y
        if abs(dx) > reach_m or abs(dy) > reach_m or not used[other] or other == row:
            continue
        square = dx * dx + dy * dy
        if least_m * least_m <= square <= most_m * most_m:
            if count == found.size:
                found, distances = np.concatenate((found, found)), np.concatenate((distances, distances))
            found[count], distances[count] = other, math.sqrt(square)
            count += 1
        if square <= crowd_m * crowd_m:
            crowds[other] += by
            crowd += 1
    return found[:count].copy(), distances[:count].copy(), crowd
