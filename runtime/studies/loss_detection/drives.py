"""Simulated drives among walking people on which something may happen to the rover or to its laser."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.measurements import FloatArray, Scan, WheelCounts, uniform_bearings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.wheels.odometer import WheelOdometer
from drivers.simulated.world.kidnapping import KidnappedPath
from drivers.simulated.world.places.world import World
from drivers.simulated.world.rover_path import RoverPath

PERIOD_NS, SAMPLE_NS = 100_000_000, 20_000_000
MIDDLE_BEAM = 540
WHEEL_STREAM, MISHAP_STREAM, GARBAGE_STREAM = 2, 3, 4
EARLIEST_S, LATEST_S = 20.0, 50.0  # of a mishap: once round the course takes about 50 s
NEAREST_M, FARTHEST_M = 1.0, 10.0
LEAST_TURN_RAD = math.radians(20.0)
CLEAR_M = 0.6  # the rover needs this much room where it is put down, and where it drives to then
AFTERWARDS_S = 8.0
COVER_M = (0.03, 0.10)  # what a cover on the lens sends back
ATTEMPTS = 1000


class MishapKind(StrEnum):
    """What happens."""

    MOVED = "moved"
    TURNED = "turned"
    MOVED_AND_TURNED = "moved and turned"
    NOTHING_BACK = "nothing back"
    COVERED = "covered"
    GARBAGE = "garbage"
    FROZEN = "frozen"
    SILENT = "silent"


KIDNAPPED = (MishapKind.MOVED, MishapKind.TURNED, MishapKind.MOVED_AND_TURNED)
BLINDED = (MishapKind.NOTHING_BACK, MishapKind.COVERED, MishapKind.GARBAGE, MishapKind.SILENT)


@dataclass(frozen=True, slots=True)
class Mishap:
    """What happens at_s seconds into a drive, for for_s seconds where it is the laser; moved_m in the map."""

    kind: MishapKind
    at_s: float
    moved_m: tuple[float, float] = (0.0, 0.0)
    turned_rad: float = 0.0
    for_s: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTick:
    """What comes in at one tick, and the true pose (3,) then."""

    stamp_ns: int
    scan: Scan | None
    wheels: tuple[WheelCounts, ...]
    truth: FloatArray


def draw_mishap(kind: MishapKind, settings: WorldSettings) -> Mishap:
    """A tick, and where the rover is put down: 1 to 10 m away and/or turned, where it has room to drive on."""
    rng = np.random.default_rng([settings.seed, MISHAP_STREAM, list(MishapKind).index(kind)])
    at_s = float(rng.uniform(EARLIEST_S, LATEST_S))
    if kind not in KIDNAPPED:
        return Mishap(kind, at_s)
    world = World(settings)
    for _ in range(ATTEMPTS):
        distance, bearing = rng.uniform(NEAREST_M, FARTHEST_M), rng.uniform(-math.pi, math.pi)
        moved = (float(distance * math.cos(bearing)), float(distance * math.sin(bearing)))
        turned = float(rng.choice((-1.0, 1.0)) * rng.uniform(LEAST_TURN_RAD, math.pi))
        if kind is MishapKind.TURNED:
            moved = (0.0, 0.0)
        if kind is MishapKind.MOVED:
            turned = 0.0
        path = KidnappedPath(RoverPath(settings.drive), at_s, moved, turned)
        if world.clearance_m(path.poses(np.arange(at_s, at_s + AFTERWARDS_S, 0.2))[0]) > CLEAR_M:
            return Mishap(kind, at_s, moved, turned)
    raise ValueError(f"no place to put the rover down in the park of seed {settings.seed}")


def simulated_ticks(
    settings: WorldSettings, duration_s: float, mishap: Mishap | None = None
) -> Iterator[SimulatedTick]:
    """Scans at 10 Hz and wheel samples at 50 Hz: a pure function of the arguments."""
    path = None
    if mishap is not None and mishap.kind in KIDNAPPED:
        path = KidnappedPath(RoverPath(settings.drive), mishap.at_s, mishap.moved_m, mishap.turned_rad)
    world, laser = World(settings, path), settings.laser
    wheels = WheelReadings(settings)
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    garbage = np.random.default_rng([settings.seed, GARBAGE_STREAM])
    frozen: FloatArray | None = None
    for start_ns in range(0, round(duration_s * 1e9), PERIOD_NS):
        stamp_ns = start_ns + round(MIDDLE_BEAM * laser.beam_period_s * 1e9)
        blind = mishap is not None and 0.0 <= start_ns * 1e-9 - mishap.at_s < mishap.for_s
        ranges = None
        if not blind or mishap is None:
            frozen = ranges = world.ranges_at(start_ns)
        else:
            ranges = blinded(mishap.kind, frozen, world, start_ns, garbage)
        scan = None
        if ranges is not None:
            seen = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
            scan = Scan(stamp_ns, seen, bearings, laser.beam_period_s, MIDDLE_BEAM, laser.range_max_m)
        yield SimulatedTick(stamp_ns, scan, wheels.until(stamp_ns), np.array(world.map_from_body(stamp_ns)))


def blinded(
    kind: MishapKind, last: FloatArray | None, world: World, start_ns: int, rng: np.random.Generator
) -> FloatArray | None:
    """The ranges (n,) that a laser in this trouble gives; a kidnapped one sees well."""
    count = world.settings.laser.beam_count
    match kind:
        case MishapKind.NOTHING_BACK:
            return np.full(count, np.inf)
        case MishapKind.COVERED:
            return rng.uniform(*COVER_M, count)
        case MishapKind.GARBAGE:
            return rng.uniform(0.0, world.settings.laser.range_max_m, count)
        case MishapKind.FROZEN:
            return last
        case MishapKind.SILENT:
            return None
    return world.ranges_at(start_ns)


class WheelReadings:
    """What the encoders count along a path, the ordinary one where no other is given, slip included."""

    def __init__(self, settings: WorldSettings, path: RoverPath | None = None) -> None:
        self._path = RoverPath(settings.drive) if path is None else path
        generator = np.random.default_rng([settings.seed, WHEEL_STREAM])
        self._wheels = tuple(WheelOdometer(SimulatedWheelSettings(), 1.0, generator) for _ in range(2))
        self._next_ns = 0

    def until(self, stamp_ns: int) -> tuple[WheelCounts, ...]:
        """All samples that have come by now."""
        samples = []
        while self._next_ns <= stamp_ns:
            travel = self._path.wheel_travel_m(np.array([self._next_ns * 1e-9]))
            left, right = (wheel.count(float(way[0])) for wheel, way in zip(self._wheels, travel, strict=True))
            samples.append(WheelCounts(self._next_ns, left, right))
            self._next_ns += SAMPLE_NS
        return tuple(samples)
