"""A simulated outdoor drive at the level of laser beams: trees, posts, bushes, walls, people and other robots.

The original recording, Tsukuba central park, is not public; this stands for it and says so wherever it is shown.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from drivers.measurements import BoolArray, FloatArray, Scan, WheelCounts, uniform_bearings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import DriveSettings, WorldSettings
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.simulated.world.places.world import Surface, World
from drivers.simulated.world.rover_path import RoverPath

PERIOD_NS, SAMPLE_NS = 100_000_000, 20_000_000
MIDDLE_BEAM = 540
SCALE = 3.0  # a course of some 66 m
ROBOTS = ((6.0, 1.4), (14.0, -1.4), (45.0, 1.6))  # m ahead at the start, m to the left of the course
ROBOT_SHARE = 0.7  # of the rover's speed: it meets and passes them
ROBOT_RADIUS_M = 0.35  # half of the paper's own robot's diagonal, seen at the height of the laser


@dataclass(frozen=True, slots=True, eq=False)
class OutdoorStep:
    """One scan, the wheel samples up to it, and the truth: pose (3,) and on whom each beam fell (n,).

    moving: people, also those who stand for a while, and other robots.
    """

    scan: Scan
    wheels: tuple[WheelCounts, ...]
    truth: FloatArray
    moving: BoolArray


def world_settings(seed: int) -> WorldSettings:
    """A park three times as large as the default one, with as many things to the square metre, and 14 people."""
    return WorldSettings(
        seed=seed,
        poles=36,
        trees=42,
        bushes=20,
        walls=6,
        people=14,
        drive=DriveSettings(course_scale=SCALE),
    )


@lru_cache(maxsize=1)
def outdoor_steps(seed: int, duration_s: float) -> tuple[OutdoorStep, ...]:
    """Scans at 10 Hz and wheel samples at 50 Hz, a pure function of seed and duration."""
    settings, wheels = world_settings(seed), SimulatedWheelSettings()
    world, laser = World(settings), settings.laser
    generator = np.random.default_rng([seed, 2])
    left, right = (WheelOdometer(wheels, 1.0, generator) for _ in range(2))
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    steps = []
    sampled_ns = 0
    for start_ns in range(0, round(duration_s * 1e9), PERIOD_NS):
        stamp_ns = start_ns + round(MIDDLE_BEAM * laser.beam_period_s * 1e9)
        samples = []
        while sampled_ns <= stamp_ns:
            travel = world.wheel_travel_m(sampled_ns)
            samples.append(WheelCounts(sampled_ns, left.count(travel[0]), right.count(travel[1])))
            sampled_ns += SAMPLE_NS
        sweep = world.sweep_at(start_ns)
        truth = np.array(world.map_from_body(stamp_ns))
        ranges, robots = in_front_of_robots(sweep.ranges_m, bearings, truth, stamp_ns, settings)
        moving = (sweep.surfaces == Surface.PERSON) | robots
        seen = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
        scan = Scan(stamp_ns, seen, bearings, laser.beam_period_s, MIDDLE_BEAM, laser.range_max_m)
        steps.append(OutdoorStep(scan, tuple(samples), truth, moving))
    return tuple(steps)


def in_front_of_robots(
    ranges_m: FloatArray, bearings_rad: FloatArray, pose: FloatArray, stamp_ns: int, settings: WorldSettings
) -> tuple[FloatArray, BoolArray]:
    """The sweep with the other robots in it, and which beams fall on one; they are round at the laser's height."""
    x, y, heading = mounted(pose, settings.laser.body_from_laser)
    ranges, on_robot = ranges_m.copy(), np.zeros(len(ranges_m), dtype=np.bool_)
    for centre in robots_m(settings, stamp_ns):
        distance = math.hypot(centre[0] - x, centre[1] - y)
        if not 2.0 * ROBOT_RADIUS_M < distance < settings.laser.range_max_m:
            continue
        off = bearings_rad - (math.atan2(centre[1] - y, centre[0] - x) - heading)
        across = distance * np.sin(off)
        inside = (np.abs(across) < ROBOT_RADIUS_M) & (np.cos(off) > 0.0)
        depth = distance * np.cos(off) - np.sqrt(np.maximum(ROBOT_RADIUS_M**2 - across**2, 0.0))
        nearer = inside & (depth < ranges)
        ranges[nearer] = depth[nearer]
        on_robot |= nearer
    return ranges, on_robot


def mounted(pose: FloatArray, body_from_laser: tuple[float, float, float]) -> tuple[float, float, float]:
    """The laser in the map."""
    x, y, turn = body_from_laser
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return float(pose[0] + cosine * x - sine * y), float(pose[1] + sine * x + cosine * y), float(pose[2] + turn)


def robots_m(settings: WorldSettings, stamp_ns: int) -> FloatArray:
    """Centres (3, 2) of the other robots, which drive beside the course and more slowly."""
    course = RoverPath(settings.drive).course
    driven = ROBOT_SHARE * settings.drive.speed_mps * stamp_ns * 1e-9
    arcs = np.array([ahead for ahead, _ in ROBOTS]) + driven
    left = np.array([beside for _, beside in ROBOTS])
    points, headings = course.points_m(arcs), course.heading_rad(arcs)
    normals = np.stack((-np.sin(headings), np.cos(headings)), axis=-1)
    beside: FloatArray = points + left[:, np.newaxis] * normals
    return beside
