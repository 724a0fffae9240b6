"""Three proposals behind one seam: what a landmark will look like from an uncertain pose.

Both forms answer with the moments of the measurement (range, bearing): its mean, its covariance S including the
sensor's noise, and its cross covariance C with the pose. From there on all proposals share one update. The motion
proposal (FastSLAM 1.0) samples the pose first, so that its pose covariance is zero here.
"""

import math
from typing import NamedTuple

from drivers.measurements import FloatArray
from slam.angles import angle_between, cosine_sine_of_step, half_turn, wrapped
from slam.arithmetic.functions import arctangent, cosine_sine, logarithm
from slam.compiled import inlined, leaf
from slam.observations import Sighting
from slam.settings.sigma_points import UnscentedWeights


class PoseBelief(NamedTuple):
    """Where a particle takes itself to be: pose (3,), covariance (3, 3) and the lower square root of that (3, 3).

    Overwritten match by match.
    """

    pose: FloatArray
    covariance: FloatArray
    root: FloatArray


class Moments(NamedTuple):
    """Predicted measurement of one landmark.

    range_m, bearing_rad: mean; rr, rb, bb: covariance S; x_r .. h_b: cross covariance of the pose (x, y, heading) with
    (range, bearing).
    """

    range_m: float
    bearing_rad: float
    rr: float
    rb: float
    bb: float
    x_r: float
    x_b: float
    y_r: float
    y_b: float
    h_r: float
    h_b: float


@leaf
def linearised_moments(belief: PoseBelief, mount: FloatArray, landmark: FloatArray, noise: Sighting) -> Moments:
    """By Jacobians (EKF, equation (3)): mount (3,) of the sensor, landmark (6,)."""
    pose, p = belief.pose, belief.covariance
    cosine, sine = cosine_sine(pose[2])
    arm_x, arm_y = cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]
    dx, dy = landmark[0] - pose[0] - arm_x, landmark[1] - pose[1] - arm_y
    square = max(dx * dx + dy * dy, 1e-12)
    distance = math.sqrt(square)
    # derivatives of range and bearing: by the landmark (l), by the heading (h); by the position they are -l
    rl_x, rl_y, bl_x, bl_y = dx / distance, dy / distance, -dy / square, dx / square
    rh, bh = rl_x * arm_y - rl_y * arm_x, bl_x * arm_y - bl_y * arm_x - 1.0
    x_r = -p[0, 0] * rl_x - p[0, 1] * rl_y + p[0, 2] * rh
    y_r = -p[1, 0] * rl_x - p[1, 1] * rl_y + p[1, 2] * rh
    h_r = -p[2, 0] * rl_x - p[2, 1] * rl_y + p[2, 2] * rh
    x_b = -p[0, 0] * bl_x - p[0, 1] * bl_y + p[0, 2] * bh
    y_b = -p[1, 0] * bl_x - p[1, 1] * bl_y + p[1, 2] * bh
    h_b = -p[2, 0] * bl_x - p[2, 1] * bl_y + p[2, 2] * bh
    xx, xy, yy = landmark[2], landmark[3], landmark[4]
    rr = rl_x * rl_x * xx + 2.0 * rl_x * rl_y * xy + rl_y * rl_y * yy
    rb = rl_x * bl_x * xx + (rl_x * bl_y + rl_y * bl_x) * xy + rl_y * bl_y * yy
    bb = bl_x * bl_x * xx + 2.0 * bl_x * bl_y * xy + bl_y * bl_y * yy
    return Moments(
        distance,
        wrapped(arctangent(dy, dx) - pose[2] - mount[2]),
        rr - rl_x * x_r - rl_y * y_r + rh * h_r + noise.rr,
        rb - rl_x * x_b - rl_y * y_b + rh * h_b + noise.rb,
        bb - bl_x * x_b - bl_y * y_b + bh * h_b + noise.bb,
        x_r,
        x_b,
        y_r,
        y_b,
        h_r,
        h_b,
    )


@inlined
def unscented_moments(
    belief: PoseBelief,
    mount: FloatArray,
    landmark: FloatArray,
    noise: Sighting,
    weights: UnscentedWeights,
    spread: float,
) -> Moments:
    """By 11 sigma points of (pose, landmark), n = 5.

    All deviations e_i are taken from the centre's own image, so that bearings wrap about it. With s = w sum e_i the
    mean is s and S = w sum e_i e_i^T + spread s s^T, spread = beta - alpha^2: that is what the centre's two weights
    (8) leave over.
    """
    pose, root = belief.pose, belief.root
    cosine, sine = cosine_sine(pose[2])
    dx, dy = landmark[0] - pose[0], landmark[1] - pose[1]
    # the landmark in the body frame, and as seen from the sensor with axes parallel to the body's
    body_x, body_y = cosine * dx + sine * dy, cosine * dy - sine * dx
    x_0, y_0 = body_x - mount[0], body_y - mount[1]
    range_0 = math.sqrt(x_0 * x_0 + y_0 * y_0)
    sum_r = sum_b = rr = rb = bb = 0.0
    x_r = x_b = y_r = y_b = h_r = h_b = 0.0
    for column in range(3):
        step_x, step_y = weights.scale * root[0, column], weights.scale * root[1, column]
        step_h = weights.scale * root[2, column]
        # the two points of a column turn by the same angle, one each way: one sine and cosine serves both
        turn_cosine, turn_sine = cosine_sine_of_step(step_h)
        moved_x, moved_y = cosine * step_x + sine * step_y, cosine * step_y - sine * step_x
        x, y = body_x - moved_x, body_y - moved_y
        x, y = turn_cosine * x + turn_sine * y - mount[0], turn_cosine * y - turn_sine * x - mount[1]
        plus_r, plus_b = math.sqrt(x * x + y * y) - range_0, angle_between(x_0, y_0, x, y)
        x, y = body_x + moved_x, body_y + moved_y
        x, y = turn_cosine * x - turn_sine * y - mount[0], turn_cosine * y + turn_sine * x - mount[1]
        minus_r, minus_b = math.sqrt(x * x + y * y) - range_0, angle_between(x_0, y_0, x, y)
        sum_r += plus_r + minus_r
        sum_b += plus_b + minus_b
        rr += plus_r * plus_r + minus_r * minus_r
        rb += plus_r * plus_b + minus_r * minus_b
        bb += plus_b * plus_b + minus_b * minus_b
        x_r += step_x * (plus_r - minus_r)
        x_b += step_x * (plus_b - minus_b)
        y_r += step_y * (plus_r - minus_r)
        y_b += step_y * (plus_b - minus_b)
        h_r += step_h * (plus_r - minus_r)
        h_b += step_h * (plus_b - minus_b)
    first_x, first_y, second_y = landmark_root(landmark)
    for column in range(4):
        sign = weights.scale if column < 2 else -weights.scale
        step_x = sign * first_x if column % 2 == 0 else 0.0
        step_y = sign * (first_y if column % 2 == 0 else second_y)
        x, y = x_0 + cosine * step_x + sine * step_y, y_0 + cosine * step_y - sine * step_x
        plus_r, plus_b = math.sqrt(x * x + y * y) - range_0, angle_between(x_0, y_0, x, y)
        sum_r += plus_r
        sum_b += plus_b
        rr += plus_r * plus_r
        rb += plus_r * plus_b
        bb += plus_b * plus_b
    w = weights.other
    mean_r, mean_b = w * sum_r, w * sum_b
    return Moments(
        range_0 + mean_r,
        wrapped(arctangent(y_0, x_0) - mount[2] + mean_b),
        w * rr + spread * mean_r * mean_r + noise.rr,
        w * rb + spread * mean_r * mean_b + noise.rb,
        w * bb + spread * mean_b * mean_b + noise.bb,
        w * x_r,
        w * x_b,
        w * y_r,
        w * y_b,
        w * h_r,
        w * h_b,
    )


@inlined
def with_noise(moments: Moments, old: Sighting, new: Sighting) -> Moments:
    """The same prediction for another feature: only the sensor's own noise differs."""
    return Moments(
        moments.range_m,
        moments.bearing_rad,
        moments.rr - old.rr + new.rr,
        moments.rb - old.rb + new.rb,
        moments.bb - old.bb + new.bb,
        moments.x_r,
        moments.x_b,
        moments.y_r,
        moments.y_b,
        moments.h_r,
        moments.h_b,
    )


@leaf
def landmark_root(landmark: FloatArray) -> tuple[float, float, float]:
    """Lower square root (xx, yx, yy) of a landmark's covariance; a direction without variance gives zero."""
    if landmark[2] <= 0.0:
        return 0.0, 0.0, math.sqrt(max(landmark[4], 0.0))
    first_x = math.sqrt(landmark[2])
    first_y = landmark[3] / first_x
    return first_x, first_y, math.sqrt(max(landmark[4] - first_y * first_y, 0.0))


@inlined
def squared_distance(moments: Moments, sighting: Sighting) -> float:
    """Squared Mahalanobis distance of a feature from its prediction; infinite if S is not positive definite."""
    determinant = moments.rr * moments.bb - moments.rb * moments.rb
    if not determinant > 0.0 or not moments.rr > 0.0:
        return math.inf
    r = sighting.range_m - moments.range_m
    b = half_turn(sighting.bearing_rad - moments.bearing_rad)
    return (moments.bb * r * r - 2.0 * moments.rb * r * b + moments.rr * b * b) / determinant


@inlined
def log_likelihood(moments: Moments, distance: float) -> float:
    """Logarithm of (4): -1/2 log |2 pi S| - distance / 2, the whole of (2 pi)^2 |S| under the root."""
    determinant = moments.rr * moments.bb - moments.rb * moments.rb
    return -0.5 * (distance + logarithm(4.0 * math.pi * math.pi * determinant))


@inlined
def fold_in(belief: PoseBelief, moments: Moments, sighting: Sighting) -> None:
    """One landmark moves pose and covariance, both in place: K = C S^-1, x += K nu, P -= K S K^T. The root does not
    follow.
    """
    pose, covariance = belief.pose, belief.covariance
    determinant = moments.rr * moments.bb - moments.rb * moments.rb
    i_rr, i_rb, i_bb = moments.bb / determinant, -moments.rb / determinant, moments.rr / determinant
    r = sighting.range_m - moments.range_m
    b = half_turn(sighting.bearing_rad - moments.bearing_rad)
    cross_r = (moments.x_r, moments.y_r, moments.h_r)
    cross_b = (moments.x_b, moments.y_b, moments.h_b)
    for i in range(3):
        gain_r = cross_r[i] * i_rr + cross_b[i] * i_rb
        gain_b = cross_r[i] * i_rb + cross_b[i] * i_bb
        pose[i] += gain_r * r + gain_b * b
        for j in range(i + 1):
            covariance[i, j] -= gain_r * cross_r[j] + gain_b * cross_b[j]
            covariance[j, i] = covariance[i, j]
        covariance[i, i] = max(covariance[i, i], 0.0)
    pose[2] = wrapped(pose[2])
