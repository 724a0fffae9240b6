"""What a pose is worth in one place: errors against its truth, and whether its quality told the truth."""

from collections.abc import Sequence

from drivers.measurements import FloatArray
from slam.estimate import Quality

RIGHT_M = 1.0
SIGMAS = 3.0


def quality_shares(errors_m: FloatArray, sigma_m: FloatArray, qualities: Sequence[Quality]) -> dict[str, float]:
    """Shares of the moments (n,) with a wrong quality, errors and published sigma in m.

    false_lost: called lost though the error is below 1 m and below 3 sigma. false_tracking: called tracking though the
    error is beyond both.
    """
    right = (errors_m < RIGHT_M) & (errors_m < SIGMAS * sigma_m)
    wrong = (errors_m > RIGHT_M) & (errors_m > SIGMAS * sigma_m)
    lost = [quality is Quality.LOST for quality in qualities]
    tracking = [quality is Quality.TRACKING for quality in qualities]
    return {"false_lost": float((right & lost).mean()), "false_tracking": float((wrong & tracking).mean())}
