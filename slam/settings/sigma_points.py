"""Spread of the sigma points, and the weights that follow from it."""

import math
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field


class UnscentedSettings(BaseModel):
    """Spread of the sigma points."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    alpha: float = Field(default=0.9, gt=0, le=2, description="spread; 0.9 is what the published code runs with")
    beta: float = Field(
        default=2.0, ge=0, le=10, description="weight of the centre in the covariance; 2 is right for a Gaussian"
    )
    kappa: float = Field(default=0.0, ge=-2.9, le=10, description="second scale; 0 as published")


class UnscentedWeights(NamedTuple):
    """scale = sqrt(n + lambda); weights of the centre for mean and covariance, and of every other point."""

    scale: float
    mean_centre: float
    covariance_centre: float
    other: float


def unscented_weights(dimension: int, settings: UnscentedSettings) -> UnscentedWeights:
    """Equations (7) and (8) for a state of `dimension` numbers."""
    spread = settings.alpha**2 * (dimension + settings.kappa)
    mean_centre = (spread - dimension) / spread
    return UnscentedWeights(
        math.sqrt(spread), mean_centre, mean_centre + 1.0 - settings.alpha**2 + settings.beta, 0.5 / spread
    )
