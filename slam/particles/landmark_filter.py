"""One landmark's own Gaussian filter, with the sampled pose taken as exact (method, step 4)."""

import math

from drivers.measurements import FloatArray
from slam.angles import angle_between, cosine_sine_of_step, wrapped
from slam.arithmetic.functions import arctangent, cosine_sine
from slam.compiled import leaf
from slam.observations import Sighting
from slam.particles.proposals import landmark_root
from slam.settings.sigma_points import UnscentedWeights


@leaf
def update_landmark(
    landmark: FloatArray,
    sensor: tuple[float, float, float],
    sighting: Sighting,
    weights: UnscentedWeights,
    spread: float,
    linear: bool,
) -> None:
    """Fold one sighting into landmark (6,), in place: 5 sigma points (n = 2), or Jacobians where `linear`."""
    dx, dy = landmark[0] - sensor[0], landmark[1] - sensor[1]
    square = max(dx * dx + dy * dy, 1e-12)
    distance, direction = math.sqrt(square), arctangent(dy, dx)
    if linear:
        rx, ry, bx, by = dx / distance, dy / distance, -dy / square, dx / square
        x_r, x_b = landmark[2] * rx + landmark[3] * ry, landmark[2] * bx + landmark[3] * by
        y_r, y_b = landmark[3] * rx + landmark[4] * ry, landmark[3] * bx + landmark[4] * by
        rr, rb, bb = rx * x_r + ry * y_r, rx * x_b + ry * y_b, bx * x_b + by * y_b
        mean_r = mean_b = 0.0
    else:
        first_x, first_y, second_y = landmark_root(landmark)
        sum_r = sum_b = rr = rb = bb = x_r = x_b = y_r = y_b = 0.0
        for column in range(4):
            sign = weights.scale if column < 2 else -weights.scale
            step_x = sign * first_x if column % 2 == 0 else 0.0
            step_y = sign * (first_y if column % 2 == 0 else second_y)
            x, y = dx + step_x, dy + step_y
            r, b = math.sqrt(x * x + y * y) - distance, angle_between(dx, dy, x, y)
            sum_r += r
            sum_b += b
            rr += r * r
            rb += r * b
            bb += b * b
            x_r += step_x * r
            x_b += step_x * b
            y_r += step_y * r
            y_b += step_y * b
        w = weights.other
        mean_r, mean_b = w * sum_r, w * sum_b
        rr = w * rr + spread * mean_r * mean_r
        rb = w * rb + spread * mean_r * mean_b
        bb = w * bb + spread * mean_b * mean_b
        x_r, x_b, y_r, y_b = w * x_r, w * x_b, w * y_r, w * y_b
    rr, rb, bb = rr + sighting.rr, rb + sighting.rb, bb + sighting.bb
    determinant = rr * bb - rb * rb
    if not determinant > 0.0:
        return
    innovation_r = sighting.range_m - distance - mean_r
    innovation_b = wrapped(sighting.bearing_rad - direction + sensor[2] - mean_b)
    gain_x_r, gain_x_b = (x_r * bb - x_b * rb) / determinant, (x_b * rr - x_r * rb) / determinant
    gain_y_r, gain_y_b = (y_r * bb - y_b * rb) / determinant, (y_b * rr - y_r * rb) / determinant
    landmark[0] += gain_x_r * innovation_r + gain_x_b * innovation_b
    landmark[1] += gain_y_r * innovation_r + gain_y_b * innovation_b
    landmark[2] = max(landmark[2] - gain_x_r * x_r - gain_x_b * x_b, 1e-10)
    landmark[3] -= gain_x_r * y_r + gain_x_b * y_b
    landmark[4] = max(landmark[4] - gain_y_r * y_r - gain_y_b * y_b, 1e-10)


@leaf
def new_landmark(
    landmark: FloatArray,
    sensor: tuple[float, float, float],
    sighting: Sighting,
    weights: UnscentedWeights,
    spread: float,
    linear: bool,
) -> None:
    """Write mean and covariance of h^-1(z) into landmark (6,): 5 sigma points over (z, R), or Jacobians."""
    direction = sensor[2] + sighting.bearing_rad
    cosine, sine = cosine_sine(direction)
    distance = sighting.range_m
    if linear:
        landmark[0], landmark[1] = sensor[0] + distance * cosine, sensor[1] + distance * sine
        across = distance * distance * sighting.bb
        skew = distance * sighting.rb
        landmark[2] = cosine * cosine * sighting.rr - 2.0 * cosine * sine * skew + sine * sine * across
        landmark[3] = cosine * sine * (sighting.rr - across) + (cosine * cosine - sine * sine) * skew
        landmark[4] = sine * sine * sighting.rr + 2.0 * cosine * sine * skew + cosine * cosine * across
        return
    first_r = math.sqrt(max(sighting.rr, 0.0))
    first_b = sighting.rb / first_r if first_r > 0.0 else 0.0
    second_b = math.sqrt(max(sighting.bb - first_b * first_b, 0.0))
    sum_x = sum_y = xx = xy = yy = 0.0
    for column in range(4):
        sign = weights.scale if column < 2 else -weights.scale
        step_r = sign * first_r if column % 2 == 0 else 0.0
        step_b = sign * (first_b if column % 2 == 0 else second_b)
        turn_cosine, turn_sine = cosine_sine_of_step(step_b)
        x = (distance + step_r) * (cosine * turn_cosine - sine * turn_sine) - distance * cosine
        y = (distance + step_r) * (sine * turn_cosine + cosine * turn_sine) - distance * sine
        sum_x += x
        sum_y += y
        xx += x * x
        xy += x * y
        yy += y * y
    w = weights.other
    mean_x, mean_y = w * sum_x, w * sum_y
    landmark[0], landmark[1] = sensor[0] + distance * cosine + mean_x, sensor[1] + distance * sine + mean_y
    landmark[2] = w * xx + spread * mean_x * mean_x
    landmark[3] = w * xy + spread * mean_x * mean_y
    landmark[4] = w * yy + spread * mean_y * mean_y
