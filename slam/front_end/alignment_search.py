"""The search for the motion under which a scan lies best on earlier ones: several starts, few points, then all.

From a single start about one scan in 500 of a real drive indoors ends in the wrong place, and one wrong heading bends
all of the map behind it.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.front_end.alignment_kernels import descend
from slam.settings.alignment import AlignmentSettings

START_DEVIATIONS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """The new scan's points (p, 2) in the body's frame and earlier scans as slam.alignment_kernels takes them."""

    settings: AlignmentSettings
    points_m: FloatArray
    past_points_m: FloatArray
    past_normals: FloatArray
    past_from_start: FloatArray
    first_rad: float
    spacing_rad: float

    def best(self, prior: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        """The motion (3,) of least cost over all starts, its information (3, 3) and its number of points.

        prior (3,) x m, y m, heading rad with covariance (3, 3), positive definite. The starts differ in heading, and
        in the position that goes with it.
        """
        own = self.settings
        information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        narrowing = np.geomspace(own.gate_first_m, own.gate_last_m, own.narrowing_steps)
        coarse = max(1, -(-len(self.points_m) // own.coarse_points))
        offsets = np.linspace(-START_DEVIATIONS, START_DEVIATIONS, own.starts) if own.starts > 1 else np.zeros(1)
        least, best = math.inf, prior
        for off in offsets:
            motion = prior + off * covariance[:, 2] / math.sqrt(covariance[2, 2])
            _, _, cost = self._descend(prior, information, motion, coarse, narrowing)
            if cost < least:
                least, best = cost, motion
        motion = best.copy()
        posterior, count, _ = self._descend(prior, information, motion, 1, np.full(own.final_steps, own.gate_last_m))
        return motion, posterior, count

    def _descend(
        self, prior: FloatArray, information: FloatArray, motion: FloatArray, stride: int, gates_m: FloatArray
    ) -> tuple[FloatArray, int, float]:
        """Moves motion (3,) in place; its information (3, 3), points on surfaces, cost."""
        posterior = np.empty((3, 3))
        count, cost = descend(
            self.points_m,
            stride,
            self.past_points_m,
            self.past_normals,
            self.past_from_start,
            self.first_rad,
            self.spacing_rad,
            prior,
            information,
            gates_m,
            self.settings.sigma_m,
            self.settings.correlated_beams,
            motion,
            posterior,
        )
        return posterior, count, cost
