"""A closed course of straights and corners whose curvature has no jump, measured by arc length."""

import math
from collections.abc import Sequence

import numpy as np

from drivers.measurements import FloatArray

CELL_M = 0.02
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


def _tangent_per_length(turn_rad: float) -> float:
    """Distance from the corner to the begin of the turn, per metre of each of its two clothoids."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    along = 0.5 * (nodes + 1.0)
    heading = 0.5 * abs(turn_rad) * along**2
    x, y = 0.5 * float(weights @ np.cos(heading)), 0.5 * float(weights @ np.sin(heading))
    return x + y * math.tan(0.5 * abs(turn_rad))


class Course:
    """Straights joined by pairs of clothoids; starts at the origin with heading 0 and comes back to it.

    Curvature is piecewise linear in arc length, so heading is known exactly and position to rounding error
    (Gauss-Legendre within cells of 2 cm).
    """

    def __init__(self, corners_m: Sequence[tuple[float, float]], corner_m: float) -> None:
        """corners_m: the polygon; corner_m: where turns begin before a corner, at most 0.45 of an edge."""
        corners = np.array(corners_m, dtype=np.float64)
        corners = np.vstack((0.5 * (corners[-1] + corners[0]), corners))
        edges = np.diff(np.vstack((corners, corners[:1])), axis=0)
        lengths = np.hypot(edges[:, 0], edges[:, 1])
        if np.any(lengths < 1e-3):
            raise ValueError(f"corners_m: two of them coincide, expected distinct ones: {corners_m}")
        directions = np.arctan2(edges[:, 1], edges[:, 0])
        knots, slopes, curvature = [0.0], [0.0], 0.0
        left_over = lengths[0]
        for i in range(1, len(corners)):
            turn = math.remainder(directions[i] - directions[i - 1], 2.0 * math.pi)
            halves = [2.0 * lengths[j] if j in (0, len(corners) - 1) else lengths[j] for j in (i - 1, i)]
            tangent = min(corner_m, 0.45 * min(halves))
            clothoid = tangent / _tangent_per_length(turn)
            start = knots[-1] + left_over - tangent
            knots += [start, start + clothoid, start + 2.0 * clothoid]
            slopes += [turn / clothoid**2, -turn / clothoid**2, 0.0]
            left_over = lengths[i] - tangent
        self.length_m = knots[-1] + left_over
        self._knots, self._slopes = np.array(knots), np.array(slopes)
        spans = np.diff(np.append(self._knots, self.length_m))
        bends = np.concatenate(([curvature], np.cumsum(self._slopes * spans)))[:-1]
        turns = bends * spans + 0.5 * self._slopes * spans**2
        self._bends = bends
        self._headings = np.concatenate(([0.0], np.cumsum(turns)))[:-1]
        self.lap_turn_rad = float(turns.sum())
        cells = np.arange(0.0, self.length_m + CELL_M, CELL_M)
        self._nodes_m = np.vstack((np.zeros((1, 2)), np.cumsum(self._steps(cells[:-1], cells[1:]), axis=0)))

    def heading_rad(self, arc_m: FloatArray) -> FloatArray:
        """Unwrapped heading after arc_m (any shape) metres, counting laps."""
        laps = np.floor(arc_m / self.length_m)
        within = arc_m - laps * self.length_m
        heading: FloatArray = laps * self.lap_turn_rad + self._heading_within(within)
        return heading

    def points_m(self, arc_m: FloatArray) -> FloatArray:
        """(..., 2) position after arc_m metres."""
        within = np.mod(arc_m, self.length_m)
        cell = (within / CELL_M).astype(np.int64)
        points: FloatArray = self._nodes_m[cell] + self._steps(cell * CELL_M, within)
        return points

    def _heading_within(self, within: FloatArray) -> FloatArray:
        piece = np.searchsorted(self._knots, within, side="right") - 1
        past = within - self._knots[piece]
        bend: FloatArray = self._bends[piece] + 0.5 * self._slopes[piece] * past
        heading: FloatArray = self._headings[piece] + past * bend
        return heading

    def _steps(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        half = 0.5 * (end - begin)
        heading = self._heading_within(0.5 * (begin + end)[..., None] + half[..., None] * GAUSS_NODES)
        mean = np.stack((np.cos(heading) @ GAUSS_WEIGHTS, np.sin(heading) @ GAUSS_WEIGHTS), axis=-1)
        return half[..., None] * mean
