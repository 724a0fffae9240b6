"""Where somebody says that the rover is: a search is restricted to it, and the decision counts no place outside it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slam.arithmetic.elementary import cosine_sine, squared
from slam.pose import Pose2

REACH_SIGMAS = 4.0
LEAST_SIGMA_M, LEAST_SIGMA_RAD = 0.1, 0.02  # nobody points more exactly
LARGEST_SIGMA_M, LARGEST_SIGMA_RAD = 100.0, math.pi  # beyond it nothing was said


@dataclass(frozen=True, slots=True)
class PosePrior:
    """map_from_body as somebody gives it, with the standard deviations of its position and heading."""

    pose: Pose2
    sigma_m: float
    sigma_rad: float

    def moved(self, increment: Pose2) -> "PosePrior":
        """The same after the rover has moved."""
        return PosePrior(self.pose @ increment, self.sigma_m, self.sigma_rad)


class Region(NamedTuple):
    """Poses that an attempt looks at: around x, y m, those farther away than reach_m left out, and those turned from
    heading rad by an angle whose cosine is below least_cosine. Variances of the prior; infinite where there is none.
    """

    x: float
    y: float
    heading: float
    reach_m: float
    least_cosine: float
    variance_m2: float
    variance_rad2: float


ANYWHERE = Region(0.0, 0.0, 0.0, math.inf, -2.0, math.inf, math.inf)


def region_of(prior: PosePrior | None) -> Region:
    """Where to look."""
    if prior is None:
        return ANYWHERE
    sigma_m = float(np.clip(prior.sigma_m, LEAST_SIGMA_M, LARGEST_SIGMA_M))
    sigma_rad = float(np.clip(prior.sigma_rad, LEAST_SIGMA_RAD, LARGEST_SIGMA_RAD))
    widest = cosine_sine(min(REACH_SIGMAS * sigma_rad, math.pi))[0]
    pose = prior.pose
    return Region(
        pose.x_m, pose.y_m, pose.heading_rad, REACH_SIGMAS * sigma_m, widest, squared(sigma_m), squared(sigma_rad)
    )
