"""The search for the motion under which a scan lies best on earlier ones: several starts, few points, then all.

From a single start about one scan in 500 of a real drive indoors ends in the wrong place, and one wrong heading bends
all of the map behind it.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, Scan
from slam.arithmetic.elementary import exponential, logarithm
from slam.arithmetic.small_matrices import eigen, inner, inverse
from slam.front_end.alignment_kernels import EarlierScans, Prior, descend, normal_equations

GATE_FIRST_M = 1.0  # points farther from the nearest surface are left out at first, m; what 10 deg move at 6 m
GATE_LAST_M = 0.15  # the same at the end, m: five times the roughness of a wall
STARTS = 3  # headings that the search starts from, up to three deviations from that of the wheels
ALONG_M = (-0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4)  # off the place found, where it is looked for along a corridor
ALONG_STEPS = 4  # from each of these
RIVAL_M = 0.05  # places so far apart are two, between which all points decide
NARROWING_STEPS = 6  # steps from the first gate to the last
FINAL_STEPS = 10  # at most so many steps at the last gate, all points
COARSE_POINTS = 60  # at most so many points while the gate narrows
START_DEVIATIONS = 3.0


def narrowing(first_m: float, steps: int) -> FloatArray:
    """(steps,) gates from the first to GATE_LAST_M, each smaller than the one before by the same share."""
    share = logarithm(GATE_LAST_M / first_m) / (steps - 1)
    return np.array((*(first_m * exponential(share * step) for step in range(steps - 1)), GATE_LAST_M))


NARROWING_M = narrowing(GATE_FIRST_M, NARROWING_STEPS)


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """The new scan's points (p, 2) in the body's frame and earlier scans."""

    points_m: FloatArray
    past: EarlierScans

    def best(
        self, prior: FloatArray, covariance: FloatArray, *, along: bool = False, starts: int | None = None
    ) -> tuple[FloatArray, FloatArray, int]:
        """The motion (3,) of least cost over all starts, its information (3, 3) and its number of points.

        prior (3,) x m, y m, heading rad with covariance (3, 3), positive definite. The starts differ in heading, and
        in the position that goes with it. along: then also along the direction in which the scan says least of the
        position, as in a corridor, where only door frames tell a wrong place from the right one.
        """
        wheels = Prior(prior, inverse(covariance))
        coarse = max(1, -(-len(self.points_m) // COARSE_POINTS))
        number = STARTS if starts is None else starts
        offsets = np.linspace(-START_DEVIATIONS, START_DEVIATIONS, number) if number > 1 else np.zeros(1)
        places = [prior + off * covariance[:, 2] / math.sqrt(covariance[2, 2]) for off in offsets]
        motion = self._cheapest(wheels, places, coarse, NARROWING_M)
        last = np.full(FINAL_STEPS, GATE_LAST_M)
        posterior, count, cost = self._descend(wheels, motion, 1, last)
        if along:
            direction = _least_known(posterior - wheels.information)
            places = [motion + off_m * direction for off_m in ALONG_M]
            other = self._cheapest(wheels, places, coarse, np.full(ALONG_STEPS, GATE_LAST_M))
            if abs(inner(other - motion, direction)) > RIVAL_M:
                its_posterior, its_count, its_cost = self._descend(wheels, other, 1, last)
                if its_cost < cost:
                    return other, its_posterior, its_count
        return motion, posterior, count

    def refined(
        self, prior: FloatArray, covariance: FloatArray, start: FloatArray, gates_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, int]:
        """The same from one start (3,), few points through gates_m (g,) and then all."""
        wheels = Prior(prior, inverse(covariance))
        motion = start.copy()
        self._descend(wheels, motion, max(1, -(-len(self.points_m) // COARSE_POINTS)), gates_m)
        posterior, count, _ = self._descend(wheels, motion, 1, np.full(FINAL_STEPS, GATE_LAST_M))
        return motion, posterior, count

    def older(self, latest: int) -> "Search":
        """The same without the latest of the earlier scans, where there are others."""
        past = self.past
        if len(past.points_m) <= latest:
            return self
        older = (past.points_m[latest:], past.normals[latest:], past.from_start[latest:])
        return Search(self.points_m, past._replace(points_m=older[0], normals=older[1], from_start=older[2]))

    def on_surfaces(self, motion: FloatArray) -> int:
        """How many points lie within the last gate of a surface under a motion (3,)."""
        count, _ = normal_equations(self.points_m, 1, self.past, motion, GATE_LAST_M, np.zeros((3, 3)), np.zeros(3))
        return int(count)

    def _cheapest(self, prior: Prior, starts: list[FloatArray], stride: int, gates_m: FloatArray) -> FloatArray:
        """Where the search of least cost ends; it begins at each start (3,), which is moved in place."""
        costs = [self._descend(prior, start, stride, gates_m)[2] for start in starts]
        return starts[int(np.argmin(costs))]

    def _descend(
        self, prior: Prior, motion: FloatArray, stride: int, gates_m: FloatArray
    ) -> tuple[FloatArray, int, float]:
        """Moves motion (3,) in place; its information (3, 3), points on surfaces, cost."""
        posterior = np.empty((3, 3))
        count, cost = descend(self.points_m, stride, self.past, prior, gates_m, motion, posterior)
        return posterior, count, cost


def same_directions(first: Scan, second: Scan) -> bool:
    """Whether the beams of two scans point the same ways in their laser's frame."""
    one, other = first.bearings_rad, second.bearings_rad
    return one.size == other.size and bool(one[0] == other[0]) and bool(one[-1] == other[-1])


def _least_known(information: FloatArray) -> FloatArray:
    """The direction (3,), without turn, of which a scan with this information (3, 3) says least."""
    _, directions = eigen(information[:2, :2])
    return np.array((*directions[:, 0], 0.0))
