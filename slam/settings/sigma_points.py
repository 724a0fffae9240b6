"""Spread of the sigma points, and the weights that follow from it."""

import math
from typing import NamedTuple

from slam.arithmetic.elementary import squared

ALPHA = 0.9  # spread; what the published code runs with
BETA = 2.0  # weight of the centre in the covariance; right for a Gaussian
KAPPA = 0.0  # second scale, as published


class UnscentedWeights(NamedTuple):
    """scale = sqrt(n + lambda); weights of the centre for mean and covariance, and of every other point."""

    scale: float
    mean_centre: float
    covariance_centre: float
    other: float


def unscented_weights(
    dimension: int, alpha: float = ALPHA, beta: float = BETA, kappa: float = KAPPA
) -> UnscentedWeights:
    """Equations (7) and (8) for a state of `dimension` numbers.

    The print of (8) has 1 - alpha + beta; the standard form 1 - alpha^2 + beta is used here.
    """
    spread = squared(alpha) * (dimension + kappa)
    mean_centre = (spread - dimension) / spread
    return UnscentedWeights(math.sqrt(spread), mean_centre, mean_centre + 1.0 - squared(alpha) + beta, 0.5 / spread)
