"""Technique 2, sparse and even features: which candidates of a scan become point features (paper III-A-2)."""

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import kernel

SPACING_M = 0.1  # technique 2: least distance of two features, m; paper: 0.10


@kernel
def _spaced(points_m: FloatArray, order: IntArray, spacing_m: float, kept: BoolArray) -> None:
    accepted = np.empty((points_m.shape[0], 2))
    count = 0
    for rank in range(order.shape[0]):
        x, y = points_m[order[rank], 0], points_m[order[rank], 1]
        clear = True
        for other in range(count):
            gap_x, gap_y = accepted[other, 0] - x, accepted[other, 1] - y
            if gap_x * gap_x + gap_y * gap_y < spacing_m * spacing_m:
                clear = False
                break
        if clear:
            accepted[count, 0], accepted[count, 1] = x, y
            count += 1
            kept[order[rank]] = True


def spaced(points_m: FloatArray, order: IntArray, spacing_m: float) -> BoolArray:
    """(k,) True for points (k, 2) that are not nearer than spacing_m to one accepted before, in the given order.

    The sentence in the paper is printed the wrong way round.
    """
    kept = np.zeros(points_m.shape[0], dtype=np.bool_)
    _spaced(np.ascontiguousarray(points_m), order, spacing_m, kept)
    return kept


def range_extrema(ranges_m: FloatArray, usable: BoolArray) -> IntArray:
    """Beams (k,) whose range is a local minimum or maximum among the usable ones, as the paper takes its features.

    Neighbours are the next usable beams on both sides, however far; the first and the last beam are no extrema.
    """
    beams = np.flatnonzero(usable)
    if beams.size < 3:
        return np.empty(0, dtype=np.int64)
    slopes = np.sign(np.diff(ranges_m[beams]))
    return beams[1:-1][slopes[:-1] * slopes[1:] < 0.0]
