"""Point-to-line alignment of one scan with earlier ones, the motion by the wheels as the prior."""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray
from slam.angles import beams_after_first, sees_all_round
from slam.arithmetic.functions import arctangent, cosine_sine, logarithm
from slam.arithmetic.small_matrices import eliminate
from slam.compiled import kernel

ROUGH_M = 0.05  # RMS distance of returns from their line beyond which they are no surface
NEIGHBOURS = 2  # to either side at least
MOST_NEIGHBOURS = 12
HALF_BASE_M = 0.15  # more of them close by, where noise would turn a short line: it has 0.02 m
WINDOW_BEAMS = 40
SOFT_SHARE = 0.15  # share of the gate by which points may miss while it is still wide
SETTLED = 1e-4  # m and rad; a smaller step ends the search
SIGMA_M = 0.03  # distance of a point from a surface seen before, m: noise and clutter
# so many neighbouring beams say the same thing; with 1 the covariance is still wide in simulation
CORRELATED_BEAMS = 2.0


class EarlierScans(NamedTuple):
    """What a scan is laid onto.

    points_m, normals (s, n, 2): earlier scans in their laser's frames, NaN where there is none. from_start (s, 4): x,
    y, cosine and sine of where the motion starts, in those frames. first_rad, spacing_rad: where their beams point.
    """

    points_m: FloatArray
    normals: FloatArray
    from_start: FloatArray
    first_rad: float
    spacing_rad: float


class Prior(NamedTuple):
    """The motion (3,) by the wheels, x m, y m, heading rad, and its information (3, 3)."""

    motion: FloatArray
    information: FloatArray


@kernel
def surface_normals(points_m: FloatArray, spacing_rad: float, normals: FloatArray) -> None:
    """Unit normals (n, 2) of the surface around every point (n, 2); NaN where there is none."""
    size = points_m.shape[0]
    is_ring = sees_all_round(spacing_rad, size)
    for beam in range(size):
        normals[beam, 0] = normals[beam, 1] = np.nan
        x, y = points_m[beam, 0], points_m[beam, 1]
        if math.isnan(x):
            continue
        step = 0.1 + 4.0 * spacing_rad * math.sqrt(x * x + y * y)
        count, sum_x, sum_y, xx, yy, xy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
        for side in (-1, 1):
            for offset in range(1, MOST_NEIGHBOURS + 1):
                other = beam + side * offset
                if is_ring:
                    other %= size
                elif other < 0 or other >= size:
                    break
                dx, dy = points_m[other, 0] - x, points_m[other, 1] - y
                square = dx * dx + dy * dy
                if square > step * step * offset * offset or (
                    offset > NEIGHBOURS and square > HALF_BASE_M * HALF_BASE_M
                ):
                    break
                if math.isnan(square):
                    continue
                count += 1
                sum_x += dx
                sum_y += dy
                xx += dx * dx
                yy += dy * dy
                xy += dx * dy
        if count < 3:
            continue
        xx -= sum_x * sum_x / count
        yy -= sum_y * sum_y / count
        xy -= sum_x * sum_y / count
        angle = 0.5 * arctangent(2.0 * xy, xx - yy)
        cosine, sine = cosine_sine(angle)
        across = sine * sine * xx - 2.0 * cosine * sine * xy + cosine * cosine * yy
        if across <= ROUGH_M * ROUGH_M * count:
            normals[beam, 0], normals[beam, 1] = -sine, cosine


@kernel
def nearest_in_scan(
    x: float, y: float, first_rad: float, spacing_rad: float, points_m: FloatArray, normals: FloatArray, gate_m: float
) -> tuple[int, float]:
    """Beam whose return on a surface is nearest to the point (x, y) in its laser's frame, and the square; -1: none."""
    best, at, size = gate_m * gate_m, -1, points_m.shape[0]
    distance = math.sqrt(x * x + y * y)
    centre = round(beams_after_first(arctangent(y, x), first_rad, spacing_rad, size))
    reach = 1 + int(min(gate_m / max(distance, 0.05) / spacing_rad, float(WINDOW_BEAMS)))
    low, high = centre - reach, centre + reach + 1
    if not sees_all_round(spacing_rad, size):
        low, high = max(low, 0), min(high, size)
    for turned in range(low, high):
        beam = turned if 0 <= turned < size else turned % size
        if math.isnan(normals[beam, 0]):
            continue
        dx, dy = points_m[beam, 0] - x, points_m[beam, 1] - y
        square = dx * dx + dy * dy
        if square < best:
            best, at = square, beam
    return at, best


@kernel
def normal_equations(
    points_m: FloatArray,
    stride: int,
    past: EarlierScans,
    motion: FloatArray,
    gate_m: float,
    information: FloatArray,
    gradient: FloatArray,
) -> tuple[int, float]:
    """Add what every stride-th point (p, 2) says of the motion (3,) to information (3, 3), its upper triangle, and to
    the gradient (3,).

    A point that misses its surface by more than sigma counts less and less (Cauchy). Returns the number of points on
    surfaces and the cost; a point without a surface costs as much as one at the gate.
    """
    variance = SIGMA_M * SIGMA_M + SOFT_SHARE * gate_m * SOFT_SHARE * gate_m
    share = stride / CORRELATED_BEAMS
    lost = 0.5 * share * logarithm(1.0 + gate_m * gate_m / variance)
    cosine, sine = cosine_sine(motion[2])
    count, cost = 0, 0.0
    for point in range(0, points_m.shape[0], stride):
        turned_x = cosine * points_m[point, 0] - sine * points_m[point, 1]
        turned_y = sine * points_m[point, 0] + cosine * points_m[point, 1]
        x, y = motion[0] + turned_x, motion[1] + turned_y
        nearest, off, slope_x, slope_y = math.inf, 0.0, 0.0, 0.0
        for number in range(past.points_m.shape[0]):
            start = past.from_start[number]
            past_x, past_y = start[0] + start[2] * x - start[3] * y, start[1] + start[3] * x + start[2] * y
            surfaces, normals = past.points_m[number], past.normals[number]
            at, square = nearest_in_scan(past_x, past_y, past.first_rad, past.spacing_rad, surfaces, normals, gate_m)
            if at >= 0 and square < nearest:
                nearest = square
                off = normals[at, 0] * (past_x - surfaces[at, 0]) + normals[at, 1] * (past_y - surfaces[at, 1])
                slope_x = start[2] * normals[at, 0] + start[3] * normals[at, 1]
                slope_y = start[2] * normals[at, 1] - start[3] * normals[at, 0]
        if nearest == math.inf:
            cost += lost
            continue
        count += 1
        cost += 0.5 * share * logarithm(1.0 + off * off / variance)
        slope_turn = slope_y * turned_x - slope_x * turned_y
        weight = share / (variance + off * off)
        information[0, 0] += weight * slope_x * slope_x
        information[0, 1] += weight * slope_x * slope_y
        information[0, 2] += weight * slope_x * slope_turn
        information[1, 1] += weight * slope_y * slope_y
        information[1, 2] += weight * slope_y * slope_turn
        information[2, 2] += weight * slope_turn * slope_turn
        gradient[0] += weight * slope_x * off
        gradient[1] += weight * slope_y * off
        gradient[2] += weight * slope_turn * off
    return count, cost


@kernel
def descend(
    points_m: FloatArray,
    stride: int,
    past: EarlierScans,
    prior: Prior,
    gates_m: FloatArray,
    motion: FloatArray,
    information: FloatArray,
) -> tuple[int, float]:
    """Steps of Gauss and Newton from motion (3,), one for each gate (g,), down to the least squares over the points'
    distances from earlier surfaces and the motion's distance from the prior; a settled search at the last gate ends.

    points_m (p, 2): the new scan in the frame whose motion is sought. motion and information (3, 3) are overwritten.
    Returns points on surfaces and the cost, before the last step.
    """
    gradient, work, step = np.empty(3), np.empty((3, 3)), np.empty((3, 1))
    count, cost = 0, math.inf
    for gate in range(gates_m.size):
        prior_cost = 0.0
        for row in range(3):
            gradient[row] = 0.0
            for column in range(3):
                information[row, column] = prior.information[row, column]
                gradient[row] += prior.information[row, column] * (motion[column] - prior.motion[column])
            prior_cost += 0.5 * gradient[row] * (motion[row] - prior.motion[row])
        count, cost = normal_equations(points_m, stride, past, motion, gates_m[gate], information, gradient)
        cost += prior_cost
        for row in range(3):
            for column in range(row):
                information[row, column] = information[column, row]
        work[:], step[:, 0] = information, gradient
        if not eliminate(work, step):
            break
        motion -= step[:, 0]
        if gates_m[gate] == gates_m[-1] and abs(step[0, 0]) + abs(step[1, 0]) + abs(step[2, 0]) < SETTLED:
            break
    return count, cost
