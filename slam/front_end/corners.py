"""Corners and free ends of walls: features where there are no trees.

A run of beams is split where it bends (iterative end-point fit); neighbouring lines that turn enough meet in a corner,
and a line whose end has only background beside it ends there.
"""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.compiled import kernel
from slam.front_end.deskew import Beams
from slam.front_end.trunks import GUARD_BEAMS, PROMINENCE_M, clear_beside
from slam.settings.front_end import FrontEndSettings

LINE_SPLIT_M = 0.08  # a wall bends where a point is so far off the chord, m
LINE_RMS_M = 0.03  # RMS distance from a line, m, beyond which it is taken for a hedge
LINE_BEAMS = 4  # least number of beams on a wall
LINE_M = 0.2  # least length of a wall, m
CORNER_RAD = 0.7  # least turn of a wall at a corner, rad
END_SPACING_M = 0.12  # a wall's end is used if its beams are so close there, m
SIGMA_CORNER_M = 0.02  # how far a corner is from the meeting of two lines, m; real ones are blunt


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
def _fit_line(points_m: FloatArray, first: int, last: int, line: FloatArray) -> int:
    """Total least squares; line: centroid x y, unit direction x y, spread along m^2, rms m. Returns the count."""
    count, sum_x, sum_y = 0, 0.0, 0.0
    for beam in range(first, last + 1):
        if not math.isnan(points_m[beam, 0]):
            count += 1
            sum_x += points_m[beam, 0]
            sum_y += points_m[beam, 1]
    if count < 3:
        return count
    mean_x, mean_y = sum_x / count, sum_y / count
    xx, yy, xy = 0.0, 0.0, 0.0
    for beam in range(first, last + 1):
        if not math.isnan(points_m[beam, 0]):
            x, y = points_m[beam, 0] - mean_x, points_m[beam, 1] - mean_y
            xx += x * x
            yy += y * y
            xy += x * y
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    cosine, sine = math.cos(angle), math.sin(angle)
    along = cosine * cosine * xx + 2.0 * cosine * sine * xy + sine * sine * yy
    across = sine * sine * xx - 2.0 * cosine * sine * xy + cosine * cosine * yy
    toward_x, toward_y = points_m[last, 0] - points_m[first, 0], points_m[last, 1] - points_m[first, 1]
    if toward_x * cosine + toward_y * sine < 0.0:
        cosine, sine = -cosine, -sine
    line[0], line[1], line[2], line[3] = mean_x, mean_y, cosine, sine
    line[4], line[5] = along, math.sqrt(max(across, 0.0) / count)
    return count


@kernel
def _write(
    features: FloatArray,
    count: int,
    x: float,
    y: float,
    xx: float,
    xy: float,
    yy: float,
    first: int,
    last: int,
    kind: int,
) -> int:
    """Append a point with covariance as (range, bearing, their covariance, first and last beam, kind)."""
    square = x * x + y * y
    distance = math.sqrt(square)
    row = features[count]
    row[0], row[1] = distance, math.atan2(y, x)
    row[2] = (x * x * xx + 2.0 * x * y * xy + y * y * yy) / square
    row[3] = (-x * y * xx + (x * x - y * y) * xy + x * y * yy) / (square * distance)
    row[4] = (y * y * xx - 2.0 * x * y * xy + x * x * yy) / (square * square)
    row[5], row[6], row[7] = first, last, kind
    return count + 1


@kernel
def _wall_end(
    line: FloatArray,
    points: int,
    corner_x: float,
    corner_y: float,
    outward: float,
    spacing_rad: float,
    end_spacing_m: float,
    variance_m2: float,
    blunt_m2: float,
    features: FloatArray,
    count: int,
    edge: int,
) -> int:
    """Append the free end of a line at its last return, moved out by half of what the beams are apart there."""
    distance = math.sqrt(corner_x * corner_x + corner_y * corner_y)
    incidence = abs(line[2] * corner_y - line[3] * corner_x) / max(distance, 1e-9)
    apart = distance * spacing_rad / max(incidence, 1e-3)
    if apart > end_spacing_m:
        return count
    along = (corner_x - line[0]) * line[2] + (corner_y - line[1]) * line[3] + 0.5 * outward * apart
    across_variance = variance_m2 * (1.0 / points + along * along / max(line[4], 1e-9)) + blunt_m2
    along_variance = apart * apart / 12.0 + blunt_m2
    cosine, sine = line[2], line[3]
    return _write(
        features,
        count,
        line[0] + along * cosine,
        line[1] + along * sine,
        cosine * cosine * along_variance + sine * sine * across_variance,
        cosine * sine * (along_variance - across_variance),
        sine * sine * along_variance + cosine * cosine * across_variance,
        edge,
        edge,
        1,
    )


@kernel
def _corners(
    points_m: FloatArray,
    ranges_m: FloatArray,
    runs: IntArray,
    spacing_rad: float,
    guard: int,
    prominence_m: float,
    face_m: float,
    split_m: float,
    rms_m: float,
    least_beams: int,
    least_m: float,
    corner_sine: float,
    end_spacing_m: float,
    variance_m2: float,
    blunt_m2: float,
    features: FloatArray,
) -> int:
    count = 0
    size = points_m.shape[0]
    ends, stack = np.empty(size + 1, dtype=np.int64), np.empty((size + 2, 2), dtype=np.int64)
    line, before = np.empty(6), np.empty(6)
    for run in range(runs.shape[0]):
        first, last = runs[run, 0], runs[run, 1]
        across_x, across_y = points_m[last, 0] - points_m[first, 0], points_m[last, 1] - points_m[first, 1]
        if last - first + 1 < least_beams or across_x * across_x + across_y * across_y < face_m * face_m:
            continue
        pieces = _split(points_m, first, last, split_m, ends, stack)
        before_points = 0
        for piece in range(pieces - 1):
            begin, end = ends[piece], ends[piece + 1]
            inner = 1 if end - begin > 4 else 0  # the beams at a bend belong to both lines or, rounded, to none
            points = 0
            if end - begin + 1 >= least_beams:
                from_beam = begin + (inner if piece > 0 else 0)
                to_beam = end - (inner if piece < pieces - 2 else 0)
                points = _fit_line(points_m, from_beam, to_beam, line)
            length = math.sqrt(
                (points_m[end, 0] - points_m[begin, 0]) ** 2 + (points_m[end, 1] - points_m[begin, 1]) ** 2
            )
            if points < least_beams - 2 or length < least_m or line[5] > rms_m:
                before_points = 0
                continue
            cross = before[2] * line[3] - before[3] * line[2] if before_points else 0.0
            if before_points and abs(cross) > corner_sine:
                offset_x, offset_y = line[0] - before[0], line[1] - before[1]
                along_before = (offset_x * line[3] - offset_y * line[2]) / cross
                x, y = before[0] + along_before * before[2], before[1] + along_before * before[3]
                along = (x - line[0]) * line[2] + (y - line[1]) * line[3]
                # Either line moves the corner along the other one, by its own error over the sine of their angle.
                one = variance_m2 * (1.0 / before_points + along_before * along_before / max(before[4], 1e-9))
                two = variance_m2 * (1.0 / points + along * along / max(line[4], 1e-9))
                one, two = one / (cross * cross), two / (cross * cross)
                count = _write(
                    features,
                    count,
                    x,
                    y,
                    line[2] * line[2] * one + before[2] * before[2] * two + blunt_m2,
                    line[2] * line[3] * one + before[2] * before[3] * two,
                    line[3] * line[3] * one + before[3] * before[3] * two + blunt_m2,
                    begin,
                    begin,
                    0,
                )
            if piece == 0 and clear_beside(ranges_m, first, -1, guard, ranges_m[first] + prominence_m):
                count = _wall_end(
                    line,
                    points,
                    points_m[first, 0],
                    points_m[first, 1],
                    -1.0,
                    spacing_rad,
                    end_spacing_m,
                    variance_m2,
                    blunt_m2,
                    features,
                    count,
                    first,
                )
            if piece == pieces - 2 and clear_beside(ranges_m, last, 1, guard, ranges_m[last] + prominence_m):
                count = _wall_end(
                    line,
                    points,
                    points_m[last, 0],
                    points_m[last, 1],
                    1.0,
                    spacing_rad,
                    end_spacing_m,
                    variance_m2,
                    blunt_m2,
                    features,
                    count,
                    last,
                )
            before[:] = line
            before_points = points
    return count


def corners(beams: Beams, runs: IntArray, settings: FrontEndSettings) -> FloatArray:
    """(c, 8) corners and free ends of walls.

    Columns: range m, bearing rad, variance m^2, covariance m rad, variance rad^2, first and last beam, 1 for an end.
    """
    found = np.empty((len(beams) + 2, 8))
    count = _corners(
        beams.points_m,
        beams.ranges_m,
        runs,
        beams.spacing_rad,
        GUARD_BEAMS,
        PROMINENCE_M,
        settings.width_max_m,
        LINE_SPLIT_M,
        LINE_RMS_M + settings.sigma_range_m,
        LINE_BEAMS,
        LINE_M,
        math.sin(CORNER_RAD),
        END_SPACING_M,
        settings.sigma_range_m**2,
        SIGMA_CORNER_M**2,
        found,
    )
    return found[:count]
