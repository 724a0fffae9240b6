"""Prediction, update, growth and shrinking of one Gaussian over the pose and many landmarks, in place.

mean (N,) and covariance (N, N) are stores with room to grow; the first n entries are in use. Jacobians are those of the
right-invariant error: see `carry`.
"""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.angles import wrapped
from slam.arithmetic.functions import cosine_sine
from slam.compiled import kernel, leaf
from slam.joint.measurement import FIRST_PLACE, JointArrays, project, slopes
from slam.observations import FeatureRows, Sighting

TILE = 16  # lines of 16 numbers of both triangles fit into the first cache


@leaf
def predict(
    mean: FloatArray,
    covariance: FloatArray,
    n: int,
    increment: FloatArray,
    increment_covariance: FloatArray,
    jump_x: float,
    jump_y: float,
) -> None:
    """Move the pose by an increment (3,) given in its own frame; O(n).

    The constants at 3, 4, 5 correct it: distances are longer by the first, turns by the second (shares), and every
    metre turns by the third (rad/m) more than the wheels say. They stay the same, so the filter finds them out.
    jump: what the last update moved the position by, if the derivative is to be taken at first estimates, else 0.
    """
    distance = math.sqrt(increment[0] * increment[0] + increment[1] * increment[1])
    more = mean[4] * increment[2] + mean[5] * distance
    direction = mean[2] + 0.5 * more
    cosine, sine = cosine_sine(direction)
    x = cosine * increment[0] - sine * increment[1]
    y = sine * increment[0] + cosine * increment[1]
    stretch = 1.0 + mean[3]
    dx, dy = stretch * x, stretch * y
    mean[0] += dx
    mean[1] += dy
    mean[2] = wrapped(mean[2] + increment[2] + more)
    half_turn, half_distance = 0.5 * increment[2], 0.5 * distance
    for column in range(n):
        p = covariance[3, column], covariance[4, column], covariance[5, column]
        sway = half_turn * p[1] + half_distance * p[2]
        heading = covariance[2, column]
        covariance[0, column] += x * p[0] - dy * sway - (dy + jump_y) * heading
        covariance[1, column] += y * p[0] + dx * sway + (dx + jump_x) * heading
        covariance[2, column] += 2.0 * sway
    for row in range(n):
        p = covariance[row, 3], covariance[row, 4], covariance[row, 5]
        sway = half_turn * p[1] + half_distance * p[2]
        heading = covariance[row, 2]
        covariance[row, 0] += x * p[0] - dy * sway - (dy + jump_y) * heading
        covariance[row, 1] += y * p[0] + dx * sway + (dx + jump_x) * heading
        covariance[row, 2] += 2.0 * sway
    q = increment_covariance
    xy = cosine * sine * (q[0, 0] - q[1, 1]) + (cosine * cosine - sine * sine) * q[0, 1]
    xh, yh = cosine * q[0, 2] - sine * q[1, 2], sine * q[0, 2] + cosine * q[1, 2]
    covariance[0, 0] += cosine * cosine * q[0, 0] - 2.0 * cosine * sine * q[0, 1] + sine * sine * q[1, 1]
    covariance[1, 1] += sine * sine * q[0, 0] + 2.0 * cosine * sine * q[0, 1] + cosine * cosine * q[1, 1]
    covariance[2, 2] += q[2, 2]
    covariance[0, 1] += xy
    covariance[0, 2] += xh
    covariance[1, 2] += yh
    for row in range(n):
        for column in range(min(row, 3)):
            covariance[row, column] = covariance[column, row]


@leaf
def whiten(projected: FloatArray, innovation: FloatArray, gap: FloatArray) -> None:
    """projected (m, n) and gap (m,) become L^-1 times themselves; innovation (m, m) = L L^T is overwritten by L."""
    m = gap.size
    for row in range(m):
        for column in range(row + 1):
            total = innovation[row, column]
            for inner in range(column):
                total -= innovation[row, inner] * innovation[column, inner]
            if row == column:
                innovation[row, row] = math.sqrt(max(total, 1e-15))
            else:
                innovation[row, column] = total / innovation[column, column]
    for row in range(m):
        line = projected[row]
        for inner in range(row):
            factor, above = innovation[row, inner], projected[inner]
            gap[row] -= factor * gap[inner]
            for column in range(line.size):
                line[column] -= factor * above[column]
        gap[row] /= innovation[row, row]
        for column in range(line.size):
            line[column] /= innovation[row, row]


@leaf
def innovate(
    joint: JointArrays,
    linearised_at: FloatArray,
    places: IntArray,
    matched: IntArray,
    features: FeatureRows,
    projected: FloatArray,
    gap: FloatArray,
    innovation: FloatArray,
) -> None:
    """Fill projected (2 k, n) = H P, gap (2 k,) and the lower triangle of their covariance, innovation (2 k, 2 k).

    matched (k,) numbers of the features, places (k,) of their landmarks; Jacobians are taken at linearised_at (N,).
    """
    mean, covariance, _, mount = joint
    k = places.size
    for index in range(k):
        at = places[index]
        slope = slopes(linearised_at, mount, linearised_at[at], linearised_at[at + 1])
        project(covariance, at, slope, projected[2 * index : 2 * index + 2])
        here = slopes(mean, mount, mean[at], mean[at + 1])
        gap[2 * index] = features.ranges_m[matched[index]] - here.range_m
        gap[2 * index + 1] = wrapped(features.bearings_rad[matched[index]] - here.bearing_rad)
    for column in range(k):
        at = places[column]
        s = slopes(linearised_at, mount, linearised_at[at], linearised_at[at + 1])
        for row in range(2 * column, 2 * k):
            p = projected[row]
            x, y = p[0] - p[at], p[1] - p[at + 1]
            innovation[row, 2 * column] = s.range_x * x + s.range_y * y + s.range_heading * p[2]
            innovation[row, 2 * column + 1] = s.bearing_x * x + s.bearing_y * y + s.bearing_heading * p[2]
        innovation[2 * column, 2 * column] += features.rr[matched[column]]
        innovation[2 * column + 1, 2 * column] += features.rb[matched[column]]
        innovation[2 * column + 1, 2 * column + 1] += features.bb[matched[column]]


@kernel
def update(
    joint: JointArrays,
    linearised_at: FloatArray,
    places: IntArray,
    matched: IntArray,
    features: FeatureRows,
    invariant: bool,
) -> None:
    """All matched features of a scan at once: matched (k,) numbers of the features, places (k,) of their landmarks.

    Jacobians are taken at linearised_at (N,).
    """
    mean, covariance, n, _ = joint
    k = places.size
    projected, gap, innovation = np.empty((2 * k, n)), np.empty(2 * k), np.zeros((2 * k, 2 * k))
    innovate(joint, linearised_at, places, matched, features, projected, gap, innovation)
    whiten(projected, innovation, gap)
    change = np.zeros(n)
    for row in range(2 * k):
        change += gap[row] * projected[row]
    apply_change(mean, covariance, n, change, projected, invariant)


@kernel
def apply_change(
    mean: FloatArray, covariance: FloatArray, n: int, change: FloatArray, projected: FloatArray, invariant: bool
) -> None:
    """Move the state by change (n,) and its covariance by - Y^T Y with Y = projected (m, n), m even."""
    turn = np.zeros(n)
    move(mean, n, change, invariant, turn)
    reduce(covariance, n, projected)
    if invariant:
        carry(covariance, n, turn)
    mirror(covariance, n)


@leaf
def move(mean: FloatArray, n: int, change: FloatArray, invariant: bool, turn: FloatArray) -> None:
    """Apply a change (n,) of pose and landmarks.

    invariant: along the exponential of the group, so that a change of heading turns the map rigidly; turn (n,) receives
    the derivative of every coordinate's displacement by the heading, for `carry`.
    """
    if not invariant:
        for index in range(n):
            mean[index] += change[index]
        mean[2] = wrapped(mean[2])
        return
    angle = change[2]
    cosine, sine = cosine_sine(angle)
    if abs(angle) < 1e-6:
        along, across = 1.0, 0.5 * angle
    else:
        along, across = sine / angle, (1.0 - cosine) / angle
    at = 0
    while at < n:
        x, y = mean[at], mean[at + 1]
        u, v = change[at] + y * angle, change[at + 1] - x * angle
        mean[at] = cosine * x - sine * y + along * u - across * v
        mean[at + 1] = sine * x + cosine * y + across * u + along * v
        turn[at], turn[at + 1] = -(mean[at + 1] - y), mean[at] - x
        at += FIRST_PLACE if at == 0 else 2
    mean[2] = wrapped(mean[2] + angle)
    for index in range(3, FIRST_PLACE):
        mean[index] += change[index]


@leaf
def reduce(covariance: FloatArray, n: int, projected: FloatArray) -> None:
    """P - Y^T Y with Y (m, n), m even, in the upper triangle; `mirror` makes the lower one.

    Two features of two rows each at a time: a line of P is fetched and stored half as often.
    """
    m = projected.shape[0]
    for row in range(n):
        line = covariance[row, row:n]
        pair = 0
        while pair + 3 < m:
            a, b = projected[pair, row:n], projected[pair + 1, row:n]
            c, d = projected[pair + 2, row:n], projected[pair + 3, row:n]
            first, second, third, fourth = a[0], b[0], c[0], d[0]
            for column in range(n - row):
                line[column] = (line[column] - (first * a[column] + second * b[column])) - (
                    third * c[column] + fourth * d[column]
                )
            pair += 4
        if pair < m:
            a, b = projected[pair, row:n], projected[pair + 1, row:n]
            first, second = a[0], b[0]
            for column in range(n - row):
                line[column] -= first * a[column] + second * b[column]
        line[0] = max(line[0], 0.0)


@leaf
def mirror(covariance: FloatArray, n: int) -> None:
    """Copy the upper triangle to the lower one, tile by tile, so that both stay in the cache."""
    for top in range(0, n, TILE):
        for left in range(0, top + 1, TILE):
            for row in range(top, min(top + TILE, n)):
                for column in range(left, min(left + TILE, row)):
                    covariance[row, column] = covariance[column, row]


@kernel
def carry(covariance: FloatArray, n: int, turn: FloatArray) -> None:
    """Carry the upper triangle from the estimate before an update to the one after it: P + t p^T + p t^T + p_hh t t^T.

    A turn of the whole map is unobservable. Its direction in the state depends on the estimate; left where it was, the
    filter would believe to have seen a part of it. In the invariant error nothing moves; in x, y, heading the rows
    follow what every coordinate's displacement t makes of the heading's error (Barrau and Bonnabel 2015).
    """
    heading = covariance[2, :n].copy()
    heading[0], heading[1] = covariance[0, 2], covariance[1, 2]
    spread = heading[2]
    for row in range(n):
        t, p = turn[row], heading[row]
        for column in range(row, n):
            covariance[row, column] += t * heading[column] + (p + spread * t) * turn[column]


@leaf
def append(mean: FloatArray, covariance: FloatArray, n: int, mount: FloatArray, sighting: Sighting) -> None:
    """A new landmark at places n and n + 1 from its first sighting and the pose."""
    cosine, sine = cosine_sine(mean[2])
    arm_x, arm_y = cosine * mount[0] - sine * mount[1], sine * mount[0] + cosine * mount[1]
    ahead_x, ahead_y = cosine_sine(mean[2] + mount[2] + sighting.bearing_rad)
    away_x, away_y = arm_x + sighting.range_m * ahead_x, arm_y + sighting.range_m * ahead_y
    mean[n], mean[n + 1] = mean[0] + away_x, mean[1] + away_y
    for column in range(n):
        covariance[n, column] = covariance[0, column] - away_y * covariance[2, column]
        covariance[n + 1, column] = covariance[1, column] + away_x * covariance[2, column]
        covariance[column, n] = covariance[n, column]
        covariance[column, n + 1] = covariance[n + 1, column]
    c, s, r = ahead_x, ahead_y, sighting.range_m
    rr, rb, bb = sighting.rr, sighting.rb * r, sighting.bb * r * r
    xx = covariance[n, 0] - away_y * covariance[n, 2]
    xy = covariance[n, 1] + away_x * covariance[n, 2]
    yy = covariance[n + 1, 1] + away_x * covariance[n + 1, 2]
    covariance[n, n] = xx + c * c * rr - 2.0 * c * s * rb + s * s * bb
    covariance[n + 1, n + 1] = yy + s * s * rr + 2.0 * c * s * rb + c * c * bb
    covariance[n, n + 1] = xy + c * s * (rr - bb) + (c * c - s * s) * rb
    covariance[n + 1, n] = covariance[n, n + 1]


@leaf
def forget(mean: FloatArray, covariance: FloatArray, n: int, at: int) -> None:
    """Remove the landmark at `at`; the last one takes its place."""
    last = n - 2
    if at == last:
        return
    for axis in range(2):
        mean[at + axis] = mean[last + axis]
        for column in range(n):
            covariance[at + axis, column] = covariance[last + axis, column]
    for row in range(last):
        for axis in range(2):
            covariance[row, at + axis] = covariance[row, last + axis]
    for row in range(2):
        for column in range(2):
            covariance[at + row, at + column] = covariance[last + row, last + column]
