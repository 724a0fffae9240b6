"""How far the error that the wheels claim can be believed, learnt from scans while the rover drives."""

import numpy as np

from drivers.measurements import FloatArray

LEAST_FACTOR, MOST_FACTOR = 1.0, 100.0  # of a variance; wheels that are good on average slip all the same
TELLING_SHARE = 0.5  # of the wheels' variance must go by an alignment before it judges them
LARGEST_RATIO = 9.0  # one outlier says no more against the wheels than three deviations
PRIOR_SCANS, SLOWEST_GAIN = 5.0, 0.02  # what the claim itself counts for; the memory is 50 scans


class WheelTrust:
    """How the wheels' own claim of their error compares with what alignment finds, estimated as the rover drives.

    Two factors for the variances of position and heading, led to where the innovation squared is as large as it should
    be, by the scans whose alignment tells more than the wheels do. They start at 1, the claim as configured.
    """

    def __init__(self) -> None:
        self._factors = np.ones(2)
        self._seen = np.zeros(2)

    @property
    def is_as_claimed(self) -> bool:
        """Whether nothing speaks against the claim."""
        return bool((self._factors == 1.0).all())

    def scaled(self, covariance: FloatArray) -> FloatArray:
        """A covariance (3, 3) as claimed, as the drive so far has shown it to be."""
        root = np.sqrt(self._factors)[[0, 0, 1]]
        scaled: FloatArray = covariance * np.outer(root, root)
        return scaled

    def compare(self, off: FloatArray, prior: FloatArray, posterior: FloatArray) -> None:
        """off (3,): what alignment added to the wheels' motion; prior and posterior covariance (3, 3)."""
        learnt = np.diag(prior) - np.diag(posterior)
        for which, rows in enumerate(((0, 1), (2,))):
            index = list(rows)
            expected = float(learnt[index].sum())
            if not expected > TELLING_SHARE * float(np.diag(prior)[index].sum()):
                continue
            ratio = min(float(np.square(off[index]).sum()) / expected, LARGEST_RATIO)
            self._seen[which] += 1.0
            gain = max(1.0 / (PRIOR_SCANS + self._seen[which]), SLOWEST_GAIN)
            factor = self._factors[which] * (1.0 + gain * (ratio - 1.0))
            self._factors[which] = min(max(factor, LEAST_FACTOR), MOST_FACTOR)
