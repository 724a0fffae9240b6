"""What a scan shows that is found again from half a metre further on: straight edges, and compact things.

Edges tell the motion across themselves and the turn; compact things (trunks, posts, legs) tell it both ways. A
compact thing's centre lies behind its front by pi/4 of its half width: without that step the front, which slides around
the thing as the laser passes, makes every drive look too short.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray, Scan
from slam.pose import rotated

NEAREST_M = 0.1  # nearer returns are the rover's own parts
GRAZING_RAD = math.radians(10.0)  # flattest incidence at which neighbouring beams still hit one surface
RANGE_NOISE_M = 0.015  # stated for a typical Hokuyo; the solution finds the true scale
SPLIT_M = 0.05  # farthest point of a straight piece from its chord
EDGE_POINTS, EDGE_LENGTH_M = 5, 0.12
EDGE_LONGEST_M = 2.0
COMPACT_M = 0.8  # widest trunk
COMPACT_BEAMS, COARSE_BEAMS = 3, 2  # the second where beams are far apart, and two on a trunk are the rule
COARSE_RAD = math.radians(0.4)
BACKGROUND_M = 0.3  # what is behind a compact thing is at least so much farther
ROUND_M = 0.008  # no trunk is round to less, and a walker near by must not outweigh everything else
SETBACK = math.pi / 4.0  # mean depth of a half circle over its radius


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """In the laser frame at the scan's stamp.

    edge_centres_m (e, 2), edge_angles_rad (e,) of the normal, edge_lengths_m (e,), edge_variances_m2 (e,) across,
    edge_angle_variances (e,) rad^2; thing_centres_m (k, 2), thing_variances_m2 (k, 2) radial and tangential.
    """

    edge_centres_m: FloatArray
    edge_angles_rad: FloatArray
    edge_lengths_m: FloatArray
    edge_variances_m2: FloatArray
    edge_angle_variances: FloatArray
    thing_centres_m: FloatArray
    thing_variances_m2: FloatArray


def scan_points(scan: Scan, laser_twist: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Points (n, 2) of the beams that returned, moved to where they are at the stamp; ranges (n,); beam numbers (n,).

    laser_twist (3,): velocity m/s ahead and left and rad/s of the laser in its own frame.
    """
    ranges = scan.ranges_m.astype(np.float64)
    with np.errstate(invalid="ignore"):
        kept = np.flatnonzero((ranges > NEAREST_M) & (ranges < scan.range_max_m))
    ranges, bearings = ranges[kept], scan.bearings_rad[kept]
    points = ranges[:, None] * np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)
    delay = (kept - scan.stamp_beam) * scan.beam_period_s
    turn, half = laser_twist[2] * delay, 0.5 * laser_twist[2] * delay
    return rotated(points, turn) + rotated(laser_twist[:2], half) * delay[:, None], ranges, kept


def shapes(scan: Scan, laser_twist: FloatArray) -> Shapes:
    """Find them. Scans that show nothing give empty arrays."""
    points, ranges, beams = scan_points(scan, laser_twist)
    if len(beams) == 0:
        return Shapes(*(np.zeros(shape) for shape in ((0, 2), 0, 0, 0, 0, (0, 2), (0, 2))))
    spacing = float(np.median(np.abs(np.diff(scan.bearings_rad)))) if len(scan.bearings_rad) > 1 else 0.0
    fewest = COARSE_BEAMS if spacing > COARSE_RAD else COMPACT_BEAMS
    edges: list[tuple[float, ...]] = []
    things: list[tuple[float, ...]] = []
    ends = _breaks(ranges, scan.bearings_rad[beams])
    begins, ends = ends[:-1], ends[1:]
    counts = (beams[ends - 1] - beams[begins] + 1).astype(np.float64)
    compact = np.minimum.reduceat(ranges, begins) * spacing * counts <= COMPACT_M
    compact &= _stand_free(ranges, beams, begins, ends, len(scan.bearings_rad))
    angles_rad = spacing * counts
    for begin, end, angle_rad, is_compact in zip(
        *(each.tolist() for each in (begins, ends, angles_rad, compact)), strict=True
    ):
        if is_compact:
            if end - begin >= fewest:
                things.append(_thing(points[begin:end], angle_rad, spacing))
        elif end - begin >= EDGE_POINTS:
            edges += _edges(points[begin:end])
    edge_rows, thing_rows = np.array(edges).reshape(-1, 6), np.array(things).reshape(-1, 4)
    angles, lengths, variances, angle_variances = edge_rows.T[2:]
    return Shapes(edge_rows[:, :2], angles, lengths, variances, angle_variances, thing_rows[:, :2], thing_rows[:, 2:])


def _breaks(ranges: FloatArray, bearings: FloatArray) -> IntArray:
    """Where one surface ends and the next begins: indices, first 0, last n."""
    step = np.abs(np.diff(bearings))
    nearer = np.minimum(ranges[:-1], ranges[1:])
    reach = nearer * np.sin(np.minimum(step, 1.0)) / math.sin(GRAZING_RAD) + 4.0 * RANGE_NOISE_M
    broken = (np.abs(np.diff(ranges)) > reach) | (step > math.radians(3.0))
    return np.concatenate(((0,), np.flatnonzero(broken) + 1, (len(ranges),)))


def _stand_free(ranges: FloatArray, beams: IntArray, begins: IntArray, ends: IntArray, beam_count: int) -> BoolArray:
    """Of which surfaces (n,) both sides look past the thing, onto something farther or nothing at all."""
    farther = np.maximum.reduceat(ranges, begins) + BACKGROUND_M
    open_between = np.diff(beams)[begins[1:] - 1] > 2
    before, after = np.ones((2, len(begins)), np.bool_)
    before[1:] = open_between | (ranges[begins[1:] - 1] > farther[1:])
    after[:-1] = open_between | (ranges[ends[:-1]] > farther[:-1])
    free: BoolArray = before & after & (beams[begins] != 0) & (beams[ends - 1] != beam_count - 1)
    return free


def _thing(points: FloatArray, angle_rad: float, spacing: float) -> tuple[float, ...]:
    """Centre x, y and the variances along and across the line of sight, of a round thing seen under an angle."""
    first, last = points[0], points[-1]
    middle = first / math.hypot(*first) + last / math.hypot(*last)
    sight = middle / math.hypot(*middle)
    sine = math.sin(0.5 * angle_rad)
    mean_m = float(np.add.reduce(np.hypot(points[:, 0], points[:, 1]))) / len(points)
    distance_m = mean_m / (1.0 - SETBACK * sine)
    radial = RANGE_NOISE_M**2 / len(points) + (0.1 * distance_m * sine) ** 2 + ROUND_M**2
    tangential = (distance_m * spacing) ** 2 / 12.0 + ROUND_M**2
    return float(distance_m * sight[0]), float(distance_m * sight[1]), radial, tangential


def _edges(points: FloatArray) -> list[tuple[float, ...]]:
    """Split where the chord is left by too much, cut what is long, fit each piece."""
    if len(points) < EDGE_POINTS:
        return []
    (first_x, first_y), (last_x, last_y) = points[0].tolist(), points[-1].tolist()
    chord_x, chord_y = last_x - first_x, last_y - first_y
    length = math.hypot(chord_x, chord_y)
    if length < EDGE_LENGTH_M:
        return []
    off = np.abs(chord_x * (points[1:-1, 1] - first_y) - chord_y * (points[1:-1, 0] - first_x))
    farthest = int(off.argmax())
    if off[farthest] > SPLIT_M * length:
        return _edges(points[: farthest + 2]) + _edges(points[farthest + 1 :])
    if length > EDGE_LONGEST_M:
        along = (points - points[0]) @ (chord_x, chord_y) / length
        cuts = np.searchsorted(along, np.arange(1, math.ceil(length / EDGE_LONGEST_M)) * EDGE_LONGEST_M)
        pieces = [piece for piece in np.split(points, cuts) if len(piece) >= EDGE_POINTS]
        return [_edge(piece) for piece in pieces if np.hypot(*(piece[-1] - piece[0])) >= EDGE_LENGTH_M]
    return [_edge(points)]


def _edge(points: FloatArray) -> tuple[float, ...]:
    """Line of least distances: centre x, y, angle of the normal, length, variance across, variance of the angle."""
    centre = np.add.reduce(points) / len(points)
    x, y = (points - centre).T
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    cosine, sine = math.cos(along), math.sin(along)
    spread = cosine * cosine * xx + 2.0 * cosine * sine * xy + sine * sine * yy
    across = max(xx + yy - spread, 0.0) / (len(points) - 2)
    noise = max(across, RANGE_NOISE_M**2)
    length = math.hypot(*(points[-1] - points[0]))
    normal = along + 0.5 * math.pi
    return float(centre[0]), float(centre[1]), normal, length, noise / len(points), noise / max(spread, 1e-9)
