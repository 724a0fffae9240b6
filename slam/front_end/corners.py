"""Corners and free ends of walls: features where there are no trees.

A run of beams is split where it bends (iterative end-point fit); neighbouring lines that turn enough meet in a corner,
and a line whose end has only background beside it ends there.
"""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic import elementary
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import arctangent, cosine_sine, hypotenuse
from slam.compiled import kernel
from slam.front_end.deskew import Beams
from slam.front_end.trunks import PROMINENCE_M, Holes, clear_beside
from slam.settings.front_end import FrontEndSettings

LINE_SPLIT_M = 0.08  # a wall bends where a point is so far off the chord, m
LINE_RMS_M = 0.03  # RMS distance from a line, m, beyond which it is taken for a hedge
LINE_BEAMS = 4  # least number of beams on a wall
LINE_M = 0.2  # least length of a wall, m
CORNER_RAD = 0.7  # least turn of a wall at a corner, rad
END_SPACING_M = 0.12  # a wall's end is used if its beams are so close there, m
SIGMA_CORNER_M = 0.02  # how far a corner is from the meeting of two lines, m; real ones are blunt
CORNER_SINE = elementary.cosine_sine(CORNER_RAD)[1]
CORNER, WALL_END = 0, 1


class Limits(NamedTuple):
    """What the scan and the settings say of walls: angle between beams, width of the widest thing that is none, RMS
    distance of returns from a line at most, variance of one return, how blunt corners are, and what holes walls may
    have.
    """

    spacing_rad: float
    face_m: float
    rms_m: float
    variance_m2: float
    blunt_m2: float
    holes: Holes


class Line(NamedTuple):
    """A line through `points` returns: centroid, unit direction towards the last one, sum of squares along it, RMS
    distance of the returns from it.
    """

    x: float
    y: float
    cosine: float
    sine: float
    along_m2: float
    rms_m: float
    points: int


class Spot(NamedTuple):
    """A point in the laser's frame, m, and its covariance, m^2."""

    x: float
    y: float
    xx: float
    xy: float
    yy: float


@kernel
def _split(points_m: FloatArray, first: int, last: int, split_m: float, ends: IntArray, stack: IntArray) -> int:
    """Beams (k,) at which a run starts, bends and ends."""
    depth, count = 0, 0
    ends[0] = first
    count = 1
    stack[0, 0], stack[0, 1] = first, last
    depth = 1
    while depth > 0:
        depth -= 1
        begin, end = stack[depth, 0], stack[depth, 1]
        chord_x, chord_y = points_m[end, 0] - points_m[begin, 0], points_m[end, 1] - points_m[begin, 1]
        length = max(math.sqrt(chord_x * chord_x + chord_y * chord_y), 1e-9)
        farthest, at = 0.0, -1
        for beam in range(begin + 1, end):
            x, y = points_m[beam, 0] - points_m[begin, 0], points_m[beam, 1] - points_m[begin, 1]
            off = abs(chord_x * y - chord_y * x) / length
            if off > farthest:
                farthest, at = off, beam
        if at >= 0 and farthest > split_m:
            stack[depth, 0], stack[depth, 1] = at, end
            stack[depth + 1, 0], stack[depth + 1, 1] = begin, at
            depth += 2
        else:
            ends[count] = end
            count += 1
    return count


@kernel
def _fit_line(points_m: FloatArray, first: int, last: int, before: Line) -> Line:
    """Total least squares; the line `before` where there are fewer than three returns."""
    count, sum_x, sum_y = 0, 0.0, 0.0
    for beam in range(first, last + 1):
        if not math.isnan(points_m[beam, 0]):
            count += 1
            sum_x += points_m[beam, 0]
            sum_y += points_m[beam, 1]
    if count < 3:
        return Line(before.x, before.y, before.cosine, before.sine, before.along_m2, before.rms_m, count)
    mean_x, mean_y = sum_x / count, sum_y / count
    xx, yy, xy = 0.0, 0.0, 0.0
    for beam in range(first, last + 1):
        if not math.isnan(points_m[beam, 0]):
            x, y = points_m[beam, 0] - mean_x, points_m[beam, 1] - mean_y
            xx += x * x
            yy += y * y
            xy += x * y
    angle = 0.5 * arctangent(2.0 * xy, xx - yy)
    cosine, sine = cosine_sine(angle)
    along = cosine * cosine * xx + 2.0 * cosine * sine * xy + sine * sine * yy
    across = sine * sine * xx - 2.0 * cosine * sine * xy + cosine * cosine * yy
    toward_x, toward_y = points_m[last, 0] - points_m[first, 0], points_m[last, 1] - points_m[first, 1]
    if toward_x * cosine + toward_y * sine < 0.0:
        cosine, sine = -cosine, -sine
    return Line(mean_x, mean_y, cosine, sine, along, math.sqrt(max(across, 0.0) / count), count)


@kernel
def _write(features: FloatArray, count: int, spot: Spot, beam: int, kind: int) -> int:
    """Append a spot as (range, bearing, their covariance, first and last beam, kind)."""
    x, y, xx, xy, yy = spot
    square = x * x + y * y
    distance = math.sqrt(square)
    row = features[count]
    row[0], row[1] = distance, arctangent(y, x)
    row[2] = (x * x * xx + 2.0 * x * y * xy + y * y * yy) / square
    row[3] = (-x * y * xx + (x * x - y * y) * xy + x * y * yy) / (square * distance)
    row[4] = (y * y * xx - 2.0 * x * y * xy + x * x * yy) / (square * square)
    row[5], row[6], row[7] = beam, beam, kind
    return count + 1


@kernel
def _wall_end(
    line: Line,
    points_m: FloatArray,
    beam: int,
    outward: float,
    limits: Limits,
    features: FloatArray,
    count: int,
) -> int:
    """Append the free end of a line at its last return, moved out by half of what the beams are apart there."""
    end_x, end_y = points_m[beam, 0], points_m[beam, 1]
    cosine, sine = line.cosine, line.sine
    distance = math.sqrt(end_x * end_x + end_y * end_y)
    incidence = abs(cosine * end_y - sine * end_x) / max(distance, 1e-9)
    apart = distance * limits.spacing_rad / max(incidence, 1e-3)
    if apart > END_SPACING_M:
        return count
    along = (end_x - line.x) * cosine + (end_y - line.y) * sine + 0.5 * outward * apart
    across_variance = (
        limits.variance_m2 * (1.0 / line.points + along * along / max(line.along_m2, 1e-9)) + limits.blunt_m2
    )
    along_variance = apart * apart / 12.0 + limits.blunt_m2
    spot = Spot(
        line.x + along * cosine,
        line.y + along * sine,
        cosine * cosine * along_variance + sine * sine * across_variance,
        cosine * sine * (along_variance - across_variance),
        sine * sine * along_variance + cosine * cosine * across_variance,
    )
    return _write(features, count, spot, beam, WALL_END)


@kernel
def _meeting(before: Line, line: Line, cross: float, limits: Limits) -> Spot:
    """Where two lines meet; cross: sine of the angle between them."""
    offset_x, offset_y = line.x - before.x, line.y - before.y
    along_before = (offset_x * line.sine - offset_y * line.cosine) / cross
    x, y = before.x + along_before * before.cosine, before.y + along_before * before.sine
    along = (x - line.x) * line.cosine + (y - line.y) * line.sine
    # Either line moves the corner along the other one, by its own error over the sine of their angle.
    one = limits.variance_m2 * (1.0 / before.points + along_before * along_before / max(before.along_m2, 1e-9))
    two = limits.variance_m2 * (1.0 / line.points + along * along / max(line.along_m2, 1e-9))
    one, two = one / (cross * cross), two / (cross * cross)
    return Spot(
        x,
        y,
        line.cosine * line.cosine * one + before.cosine * before.cosine * two + limits.blunt_m2,
        line.cosine * line.sine * one + before.cosine * before.sine * two,
        line.sine * line.sine * one + before.sine * before.sine * two + limits.blunt_m2,
    )


@kernel
def _corners(points_m: FloatArray, ranges_m: FloatArray, runs: IntArray, limits: Limits, features: FloatArray) -> int:
    count = 0
    size = points_m.shape[0]
    ends, stack = np.empty(size + 1, dtype=np.int64), np.empty((size + 2, 2), dtype=np.int64)
    line = Line(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
    before = line
    for run in range(runs.shape[0]):
        first, last = runs[run, 0], runs[run, 1]
        across_x, across_y = points_m[last, 0] - points_m[first, 0], points_m[last, 1] - points_m[first, 1]
        narrow = across_x * across_x + across_y * across_y < limits.face_m * limits.face_m
        if last - first + 1 < LINE_BEAMS or narrow:
            continue
        pieces = _split(points_m, first, last, LINE_SPLIT_M, ends, stack)
        bends = False  # whether the piece before was a wall
        for piece in range(pieces - 1):
            begin, end = ends[piece], ends[piece + 1]
            inner = 1 if end - begin > 4 else 0  # the beams at a bend belong to both lines or, rounded, to none
            if end - begin + 1 >= LINE_BEAMS:
                from_beam = begin + (inner if piece > 0 else 0)
                to_beam = end - (inner if piece < pieces - 2 else 0)
                line = _fit_line(points_m, from_beam, to_beam, line)
            length = hypotenuse(points_m[end, 0] - points_m[begin, 0], points_m[end, 1] - points_m[begin, 1])
            short = end - begin + 1 < LINE_BEAMS or line.points < LINE_BEAMS - 2 or length < LINE_M
            if short or line.rms_m > limits.rms_m:
                bends = False
                continue
            cross = before.cosine * line.sine - before.sine * line.cosine if bends else 0.0
            if bends and abs(cross) > CORNER_SINE:
                count = _write(features, count, _meeting(before, line, cross, limits), begin, CORNER)
            if piece == 0 and clear_beside(ranges_m, first, -1, limits.holes, PROMINENCE_M):
                count = _wall_end(line, points_m, first, -1.0, limits, features, count)
            if piece == pieces - 2 and clear_beside(ranges_m, last, 1, limits.holes, PROMINENCE_M):
                count = _wall_end(line, points_m, last, 1.0, limits, features, count)
            before, bends = line, True
    return count


def corners(beams: Beams, runs: IntArray, settings: FrontEndSettings, holes: Holes) -> FloatArray:
    """(c, 8) corners and free ends of walls.

    Columns: range m, bearing rad, variance m^2, covariance m rad, variance rad^2, first and last beam, 1 for an end.
    """
    found = np.empty((len(beams) + 2, 8))
    sigma_m = settings.sigma_range_m
    limits = Limits(
        beams.spacing_rad, settings.width_max_m, LINE_RMS_M + sigma_m, squared(sigma_m), squared(SIGMA_CORNER_M), holes
    )
    return found[: _corners(beams.points_m, beams.ranges_m, runs, limits, found)]
