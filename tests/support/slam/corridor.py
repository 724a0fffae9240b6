"""A robot indoors: a ring of corridors with niches for doors, a laser of one beam a degree, one scan every 0.7 m."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, OdometryPose, Scan, uniform_bearings
from slam.pose import Pose2

BEARINGS_RAD = uniform_bearings(-0.5 * math.pi, math.pi / 180.0, 180)
RANGE_SIGMA_M = 0.015
RANGE_MAX_M = 20.0
HALF_WIDTH_M = 1.2
CORNERS_M = ((0.0, 0.0), (24.0, 0.0), (24.0, 15.0), (0.0, 15.0))  # the middle of the corridors
STEP_M, STEP_RAD = 0.7, 0.5
SCAN_NS = 3_000_000_000


def niched_wall(start: tuple[float, float], end: tuple[float, float], generator: np.random.Generator) -> FloatArray:
    """Ends of the lines (l, 4) of a wall in which doors stand back by 0.25 m, on the left of its direction."""
    (x, y), (to_x, to_y) = start, end
    length = math.hypot(to_x - x, to_y - y)
    ahead = np.array(((to_x - x) / length, (to_y - y) / length))
    left = np.array((-ahead[1], ahead[0]))
    points, at = [np.array(start)], 0.0
    while True:
        at += generator.uniform(1.2, 3.5)
        if at + 1.5 > length:
            break
        begin, finish = np.array(start) + at * ahead, np.array(start) + (at + 0.9) * ahead
        points += [begin, begin + 0.25 * left, finish + 0.25 * left, finish]
        at += 0.9
    points.append(np.array(end))
    return np.array([(*a, *b) for a, b in pairwise(points)])


def ring_of_corridors(seed: int) -> FloatArray:
    """Lines (l, 4) of the walls outside and inside of the ring."""
    generator = np.random.default_rng(seed)
    lines = []
    for off_m in (HALF_WIDTH_M, -HALF_WIDTH_M):
        low_x, low_y = CORNERS_M[0][0] - off_m, CORNERS_M[0][1] - off_m
        high_x, high_y = CORNERS_M[2][0] + off_m, CORNERS_M[2][1] + off_m
        loop = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y), (low_x, low_y)]
        if off_m > 0.0:  # doors stand back from the corridor: to the right of the outer loop, left of the inner one
            loop = loop[::-1]
        lines += [niched_wall(a, b, generator) for a, b in pairwise(loop)]
    return np.vstack(lines)


def ranges_of(map_from_laser: Pose2, lines: FloatArray) -> FloatArray:
    """(180,) exact ranges to the nearest of the lines (l, 4), inf where there is none."""
    directions = BEARINGS_RAD + map_from_laser.heading_rad
    ray_x, ray_y = np.cos(directions)[:, np.newaxis], np.sin(directions)[:, np.newaxis]
    x, y = lines[:, 0] - map_from_laser.x_m, lines[:, 1] - map_from_laser.y_m
    along_x, along_y = lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = ray_x * along_y - ray_y * along_x
        distance = (x * along_y - y * along_x) / determinant
        share = (x * ray_y - y * ray_x) / determinant
        hit = (distance > 0.0) & (share >= 0.0) & (share <= 1.0)
    ranges: FloatArray = np.where(hit, distance, np.inf).min(axis=1)
    return ranges


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Where the robot is when it takes a scan, and what its wheels and its laser say."""

    map_from_body: Pose2
    scan: Scan
    wheels: OdometryPose


def ring_path(laps: float) -> list[Pose2]:
    """Poses at the scans: along the middle of the corridors, turning on the spot at their corners."""
    poses, heading = [Pose2(8.0, 0.0, 0.0)], 0.0
    left_m = laps * sum(math.dist(a, b) for a, b in zip(CORNERS_M, CORNERS_M[1:] + CORNERS_M[:1], strict=True))
    corner = 1
    while left_m > 0.0:
        x, y = CORNERS_M[corner % 4]
        here = poses[-1]
        to_go = math.hypot(x - here.x_m, y - here.y_m)
        step = min(STEP_M, to_go)
        left_m -= step
        if to_go > 1e-9:
            poses.append(here @ Pose2(step, 0.0, 0.0))
            continue
        for _ in range(3):
            poses.append(poses[-1] @ Pose2(0.0, 0.0, math.pi / 6.0))
        heading += math.pi / 2.0
        corner += 1
    return poses


def drive_round(
    seed: int, laps: float = 1.1, body_from_laser: Pose2 | None = None, period_ns: int = SCAN_NS
) -> list[Stop]:
    """The drive with wheels that pull to one side by 2 deg/m and slip at random, as a real robot's indoors."""
    generator = np.random.default_rng(seed)
    mount = Pose2() if body_from_laser is None else body_from_laser
    lines = ring_of_corridors(seed)
    poses = ring_path(laps)
    stops: list[Stop] = []
    wheels = poses[0]
    for number, pose in enumerate(poses):
        if number > 0:
            moved = poses[number - 1].inverse() @ pose
            way = math.hypot(moved.x_m, moved.y_m)
            slip = generator.normal(0.0, 0.06) * math.sqrt(way)
            turned = math.radians(2.0) * way + generator.normal(0.0, 0.03) * math.sqrt(way)
            turned += generator.normal(0.0, 0.08) * math.sqrt(abs(moved.heading_rad))
            wheels = wheels @ Pose2(moved.x_m + slip, moved.y_m, moved.heading_rad + turned)
        ranges = ranges_of(pose @ mount, lines) + generator.normal(0.0, RANGE_SIGMA_M, BEARINGS_RAD.size)
        measured: NDArray[np.float32] = np.where(ranges < RANGE_MAX_M, ranges, np.nan).astype(np.float32)
        stamp_ns = number * period_ns
        sample = OdometryPose(stamp_ns, wheels.x_m, wheels.y_m, wheels.heading_rad)
        stops.append(Stop(pose, Scan(stamp_ns, measured, BEARINGS_RAD, range_max_m=RANGE_MAX_M), sample))
    return stops
