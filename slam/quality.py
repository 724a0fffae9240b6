"""Whether the published pose can be believed."""

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from slam.estimate import Quality

FloatArray = NDArray[np.float64]


class QualitySettings(BaseModel):
    """Bounds between tracking, uncertain and lost."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    uncertain_m: float = Field(
        default=1.0, gt=0, le=100, description="m; standard deviation of the position, larger axis"
    )
    lost_m: float = Field(default=5.0, gt=0, le=1000, description="m; the same")
    uncertain_blind_s: float = Field(default=1.0, gt=0, le=100, description="s without a scan")
    lost_blind_s: float = Field(default=10.0, gt=0, le=1000, description="s without a scan")
    uncertain_gap_m: float = Field(
        default=1.5, gt=0, le=100, description="m between particles and joint Gaussian beyond 3 sigma of it"
    )


def judge(settings: QualitySettings, covariance: FloatArray, gap_m: float, blind_s: float) -> Quality:
    """Quality from the covariance (3, 3), the distance between both estimators, and the time since the last scan."""
    if not np.isfinite(covariance).all():
        return Quality.LOST
    difference, cross = covariance[0, 0] - covariance[1, 1], covariance[0, 1]
    largest = 0.5 * (covariance[0, 0] + covariance[1, 1] + math.hypot(difference, 2.0 * cross))
    deviation = math.sqrt(max(largest, 0.0))
    if deviation > settings.lost_m or blind_s > settings.lost_blind_s:
        return Quality.LOST
    apart = gap_m > settings.uncertain_gap_m + 3.0 * deviation
    if deviation > settings.uncertain_m or blind_s > settings.uncertain_blind_s or apart:
        return Quality.UNCERTAIN
    return Quality.TRACKING
