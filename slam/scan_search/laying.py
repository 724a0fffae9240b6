"""Scans of a stretch of the way laid onto the ground of a map, at every place and heading, in slices of bounded work.

The same points in the mirror, which lie nowhere, are tried with them: what those reach is what chance reaches here.
Correlative scan matching (Olson 2009), with an answer that says how far it stands out.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.functions import lengths
from slam.pose import Pose2, wrap_rad, wrap_rads
from slam.recognise.attempt import odds_of
from slam.scan_search.ground import CELL_M, Ground
from slam.scan_search.kernels import HEADINGS, QUARTERS, STEPS, TURNS, refine, try_headings

TRIED_POINTS = 120  # at every place; a pose is refined with all of them
GOLDEN = 0.618034  # share by which the points are taken that are tried first, from everywhere
REFINED = 32  # poses
LOOKED_THROUGH = 3000  # the best ones, of which the refined ones are chosen
APART_M, APART_RAD = 1.0, 0.3  # nearer to each other, two poses are the same place
LOOKS_A_POINT = sum((2 * reach + 1) * (2 * reach + 1) for _, _, reach in STEPS) * (2 * TURNS + 1)

Placed = tuple[float, float, float, float]  # how well the points lie, x m, y m, heading rad


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """The best place. odds: natural logarithm, against every other place and against chance; mirror_odds: what the
    same points reached in the mirror. share: of the points that lie on something, less those that lie in the open.
    """

    map_from_body: Pose2
    odds: float
    mirror_odds: float
    share: float


class Laying:
    """points (n, 2), body frame, on the ground of one map. No random part: a replay repeats it."""

    def __init__(self, ground: Ground, points_m: FloatArray) -> None:
        self._count = len(points_m)
        self._sides = [_Side(ground, points_m), _Side(ground, points_m * (1.0, -1.0))]

    def advance(self, most_looks: int) -> Laid | None:
        """Do a slice of the work; the result when that was the last one."""
        for side in self._sides:
            if not side.is_done:
                most_looks -= side.advance(most_looks)
            if most_looks <= 0:
                return None
        found, mirrored = (side.apart() for side in self._sides)
        if not found:
            return Laid(Pose2(), -math.inf, -math.inf, 0.0)
        own, mirror = [value for value, *_ in found], [value for value, *_ in mirrored]
        rivals = [*own[1:], *mirror]
        mirror_rivals = [*own, *mirror[1:]]
        return Laid(
            Pose2(found[0][1], found[0][2], wrap_rad(found[0][3])),
            odds_of([own[0], *rivals], rivals),
            odds_of([mirror[0], *mirror_rivals], mirror_rivals) if mirror else -math.inf,
            own[0] / self._count,
        )

    @property
    def state(self) -> tuple[int, ...]:
        """How far it has come."""
        return tuple(count for side in self._sides for count in side.progress)


class _Side:
    """The points or their mirror image."""

    def __init__(self, ground: Ground, points_m: FloatArray) -> None:
        self._ground = ground
        self._points = points_m / CELL_M
        spread = np.argsort(GOLDEN * np.arange(len(points_m)) % 1.0, kind="stable")
        self._tried = np.ascontiguousarray(self._points[spread[:TRIED_POINTS]])
        shape = (len(ground.places), QUARTERS)
        self._best = np.full(shape, -len(points_m) - 1, dtype=np.int32)
        self._headings = np.zeros(shape, dtype=np.int32)
        self._heading = 0
        self._chosen: list[FloatArray] | None = None
        self._placed: list[Placed] = []

    @property
    def progress(self) -> tuple[int, int]:
        """Headings tried, and poses refined."""
        return self._heading, len(self._placed)

    @property
    def is_done(self) -> bool:
        """Whether nothing is left to do."""
        return self._chosen is not None and len(self._placed) == len(self._chosen)

    def advance(self, most_looks: int) -> int:
        """Try places, then refine the best; returns about how many cells were looked up."""
        ground = self._ground
        self._heading, looks = try_headings(
            ground.coarse, ground.places, self._tried, self._heading, most_looks, self._best, self._headings
        )
        if self._heading < HEADINGS:
            return max(looks, most_looks)
        if self._chosen is None:
            self._chosen = self._choose()
        while len(self._placed) < len(self._chosen) and looks < most_looks:
            pose = self._chosen[len(self._placed)]
            value = refine(ground.fine, self._points, pose)
            x_m, y_m = ground.x_m + CELL_M * pose[0], ground.y_m + CELL_M * pose[1]
            self._placed.append((float(value), float(x_m), float(y_m), float(pose[2])))
            looks += LOOKS_A_POINT * len(self._points)
        return looks if self.is_done else max(looks, most_looks)

    def apart(self) -> list[Placed]:
        """The refined poses that are places of their own, the best first."""
        kept: list[Placed] = []
        for placed in sorted(self._placed, reverse=True):
            if not any(_same(placed, other) for other in kept):
                kept.append(placed)
        return kept

    def _choose(self) -> list[FloatArray]:
        """Poses (3,), in cells and rad, of the best places that are apart."""
        order = np.argsort(-self._best, axis=None, kind="stable")[:LOOKED_THROUGH]
        places, quarters = np.divmod(order, QUARTERS)
        rows, columns = self._ground.places[places].T + 0.5
        poses = np.column_stack((columns, rows, 2.0 * math.pi / HEADINGS * self._headings[places, quarters]))
        chosen: list[FloatArray] = []
        while len(poses) and len(chosen) < REFINED:
            best = poses[0].copy()
            chosen.append(best)
            off = poses - best
            near = lengths(off[:, :2]) < APART_M / CELL_M
            poses = poses[~(near & (np.abs(wrap_rads(off[:, 2])) < APART_RAD))]
        return chosen


def _same(placed: Placed, other: Placed) -> bool:
    apart_m = math.hypot(placed[1] - other[1], placed[2] - other[2])
    return apart_m < APART_M and abs(wrap_rad(placed[3] - other[3])) < APART_RAD
