"""Range and bearing of a landmark as the joint Gaussian sees them: both uncertain, both correlated.

State vector: x m, y m, heading rad of the body in the map; three constants of the odometry (see
slam.joint.kernels.predict); then, from FIRST_PLACE on, x m, y m of one landmark after the other.
"""

import math
from typing import NamedTuple

from drivers.measurements import FloatArray
from slam.angles import wrapped
from slam.arithmetic.functions import arctangent, cosine_sine
from slam.compiled import leaf
from slam.observations import Sighting

FIRST_PLACE = 6


class JointArrays(NamedTuple):
    """mean (N,) and covariance (N, N) with room to grow, of which the first `size` entries are in use; mount (3,) is
    body_from_laser.
    """

    mean: FloatArray
    covariance: FloatArray
    size: int
    mount: FloatArray


class Slopes(NamedTuple):
    """Predicted range and bearing and their derivatives; by the landmark they are minus those by the position."""

    range_m: float
    bearing_rad: float
    range_x: float
    range_y: float
    range_heading: float
    bearing_x: float
    bearing_y: float
    bearing_heading: float


@leaf
def slopes(pose: FloatArray, mount: FloatArray, x: float, y: float) -> Slopes:
    """h and its Jacobian at pose (at least 3,) and a landmark at x, y; mount (3,) is body_from_laser."""
    cosine, sine = cosine_sine(pose[2])
    arm_x, arm_y = cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]
    dx, dy = x - pose[0] - arm_x, y - pose[1] - arm_y
    square = max(dx * dx + dy * dy, 1e-4)
    distance = math.sqrt(square)
    range_x, range_y, bearing_x, bearing_y = -dx / distance, -dy / distance, dy / square, -dx / square
    return Slopes(
        distance,
        wrapped(arctangent(dy, dx) - pose[2] - mount[2]),
        range_x,
        range_y,
        range_y * arm_x - range_x * arm_y,
        bearing_x,
        bearing_y,
        bearing_y * arm_x - bearing_x * arm_y - 1.0,
    )


@leaf
def project(covariance: FloatArray, at: int, slope: Slopes, into: FloatArray) -> None:
    """into (2, n) = H P for the landmark whose coordinates stand at `at`; covariance (n, n) symmetric."""
    for column in range(into.shape[1]):
        x, y = covariance[0, column] - covariance[at, column], covariance[1, column] - covariance[at + 1, column]
        heading = covariance[2, column]
        into[0, column] = slope.range_x * x + slope.range_y * y + slope.range_heading * heading
        into[1, column] = slope.bearing_x * x + slope.bearing_y * y + slope.bearing_heading * heading


@leaf
def innovation_covariance(covariance: FloatArray, at: int, slope: Slopes) -> tuple[float, float, float]:
    """H P H^T as rr, rb, bb."""
    p = covariance
    xx = p[0, 0] - 2.0 * p[0, at] + p[at, at]
    xy = p[0, 1] - p[0, at + 1] - p[1, at] + p[at, at + 1]
    yy = p[1, 1] - 2.0 * p[1, at + 1] + p[at + 1, at + 1]
    xh, yh, hh = p[0, 2] - p[2, at], p[1, 2] - p[2, at + 1], p[2, 2]
    s = slope
    r_x = s.range_x * xx + s.range_y * xy + s.range_heading * xh
    r_y = s.range_x * xy + s.range_y * yy + s.range_heading * yh
    r_h = s.range_x * xh + s.range_y * yh + s.range_heading * hh
    b_x = s.bearing_x * xx + s.bearing_y * xy + s.bearing_heading * xh
    b_y = s.bearing_x * xy + s.bearing_y * yy + s.bearing_heading * yh
    b_h = s.bearing_x * xh + s.bearing_y * yh + s.bearing_heading * hh
    return (
        r_x * s.range_x + r_y * s.range_y + r_h * s.range_heading,
        r_x * s.bearing_x + r_y * s.bearing_y + r_h * s.bearing_heading,
        b_x * s.bearing_x + b_y * s.bearing_y + b_h * s.bearing_heading,
    )


@leaf
def fold(
    mean: FloatArray, covariance: FloatArray, at: int, slope: Slopes, sighting: Sighting, work: FloatArray
) -> None:
    """Fold one sighting of the landmark at `at` into mean and covariance, in place.

    mean (n,), covariance (n, n); work (2, n) is overwritten. The update is P - Y^T Y with Y the whitened projection, so
    P stays symmetric.
    """
    project(covariance, at, slope, work)
    s_rr, s_rb, s_bb = innovation_covariance(covariance, at, slope)
    s_rr, s_rb, s_bb = s_rr + sighting.rr, s_rb + sighting.rb, s_bb + sighting.bb
    first = math.sqrt(s_rr)
    across = s_rb / first
    second = math.sqrt(max(s_bb - across * across, 1e-15))
    range_gap = (sighting.range_m - slope.range_m) / first
    bearing_gap = (wrapped(sighting.bearing_rad - slope.bearing_rad) - across * range_gap) / second
    size = mean.size
    for column in range(size):
        work[0, column] /= first
        work[1, column] = (work[1, column] - across * work[0, column]) / second
        mean[column] += work[0, column] * range_gap + work[1, column] * bearing_gap
    for row in range(size):
        a, b = work[0, row], work[1, row]
        for column in range(size):
            covariance[row, column] -= a * work[0, column] + b * work[1, column]
    mean[2] = wrapped(mean[2])
