"""The motion that scans show of a rover whose wheels have slipped, and whether a rover can have moved so."""

import math
from dataclasses import replace

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.small_matrices import inverse
from slam.odometry.odometry import Increment
from slam.pose import wrap_rad

SLIDE_MPS = 0.5  # faster than its wheels roll, no rover moves; that they roll backwards they may not know


def is_too_far(increment: Increment, motion: FloatArray) -> bool:
    """Whether a rover with this motion (3,), x m, y m, heading rad, would have moved faster than its wheels let it."""
    rolled_m = math.hypot(increment.mean[0], increment.mean[1])
    return math.hypot(motion[0], motion[1]) > rolled_m + SLIDE_MPS * increment.duration_s


def corrected(increment: Increment, motion: FloatArray, information: FloatArray, *, suspected: bool) -> Increment:
    """The increment with another motion (3,) of which scans say so much, (3, 3).

    suspected: wheels that are sure of themselves say otherwise, and people who walk together look like a slide, but
    not like a turn: then either place may be right.
    """
    covariance = inverse(information)
    if suspected:
        off = np.append(motion[:2] - increment.mean[:2], 0.0)
        covariance += np.outer(off, off)
    mean = motion.copy()
    mean[2] = wrap_rad(float(mean[2]))
    return replace(increment, mean=mean, covariance=0.5 * (covariance + covariance.T), at_rest=False)
