"""The simulated world: a pure function of its settings and of the time since it began.

Two processes that hold the same settings agree on everything in it, bit for bit.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.park import Park, plant
from drivers.simulated.people import People
from drivers.simulated.ray_casting import circle_hits, wall_hits
from drivers.simulated.rover_path import RoverPath
from drivers.simulated.world_settings import WorldSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
NANOSECOND_S = 1e-9
BUSH_DEPTH_M = 0.08
BUSH_GAP_SHARE = 0.15
MIXED_JUMP_M = 0.3


class Surface(IntEnum):
    """What a beam fell on."""

    NOTHING = 0
    POLE = 1
    TREE = 2
    BUSH = 3
    WALL = 4
    PERSON = 5


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Posts and trunks as they really stand: positions_m (l, 2) of their centres in the map, radii_m (l,)."""

    positions_m: FloatArray
    radii_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """One sweep with the truth about it: ranges_m (n,) inf = nothing; surfaces (n,) Surface;
    landmarks (n,) index into Landmarks, -1 elsewhere."""

    ranges_m: FloatArray
    surfaces: IntArray
    landmarks: IntArray


class World:
    """A park with people and one rover in it."""

    def __init__(self, settings: WorldSettings) -> None:
        self.settings = settings
        self._path = RoverPath(settings.drive)
        rng = np.random.default_rng([settings.seed, 0])
        self._park = plant(settings, self._path.course, rng)
        corners = self._path.course.points_m(np.arange(0.0, self._path.course.length_m, 0.1))
        low, high = corners.min(axis=0) - settings.margin_m, corners.max(axis=0) + settings.margin_m
        self._people = People(settings.people, self._path.course, low, high, rng)
        circles = _fixed_circles(self._park)
        self._fixed_m, self._fixed_radii_m, self._fixed_surfaces, self._fixed_landmarks = circles
        laser = settings.laser
        steps = np.arange(laser.beam_count, dtype=np.float64)
        self._bearings_rad: FloatArray = laser.first_bearing_rad + laser.beam_spacing_rad * steps
        self._delays_s: FloatArray = laser.beam_period_s * steps

    def landmarks(self) -> Landmarks:
        """What a perfect map would hold."""
        return Landmarks(self._park.landmarks_m.copy(), self._park.radii_m.copy())

    def map_from_body(self, t_ns: int) -> tuple[float, float, float]:
        """x m, y m, heading rad (unwrapped) of the body in the map; (0, 0, 0) at the start."""
        points, headings = self._path.poses(np.array([t_ns * NANOSECOND_S]))
        return float(points[0, 0]), float(points[0, 1]), float(headings[0])

    def wheel_travel_m(self, t_ns: int) -> tuple[float, float]:
        """How far the left and the right wheel have rolled since the world began, m, forward positive."""
        left, right = self._path.wheel_travel_m(np.array([t_ns * NANOSECOND_S]))
        return float(left[0]), float(right[0])

    def ranges_at(self, t_ns: int) -> FloatArray:
        """(beam_count,) m of the sweep whose step 0 is measured at t_ns; inf where nothing came back."""
        return self.sweep_at(t_ns).ranges_m

    def sweep_at(self, t_ns: int) -> Sweep:
        """The same with what each beam fell on; each beam is cast at its own time."""
        laser = self.settings.laser
        rng = np.random.default_rng([self.settings.seed, 1, abs(t_ns)])
        time_s: FloatArray = t_ns * NANOSECOND_S + self._delays_s
        body_m, heading = self._path.poses(time_s)
        mount_x, mount_y, mount_heading = laser.body_from_laser
        cosine, sine = np.cos(heading), np.sin(heading)
        lever = np.stack((cosine * mount_x - sine * mount_y, sine * mount_x + cosine * mount_y), axis=-1)
        origins = body_m + lever
        bearing: FloatArray = heading + mount_heading + self._bearings_rad
        directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
        ranges, surfaces, landmarks = self._cast(time_s, body_m, origins, directions, rng)
        hit = np.isfinite(ranges)
        ranges = _mixed(ranges, rng, laser.mixed_share)
        ranges = ranges + laser.sigma_range_m * rng.standard_normal(ranges.shape)
        lost = (rng.random(ranges.shape) < laser.drop_out_share) | (ranges > laser.range_max_m) | ~hit
        ranges[lost] = np.inf
        surfaces[lost] = Surface.NOTHING
        landmarks[lost] = -1
        return Sweep(np.maximum(ranges, 0.02), surfaces, landmarks)

    def _cast(
        self,
        time_s: FloatArray,
        body_m: FloatArray,
        origins: FloatArray,
        directions: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, IntArray, IntArray]:
        middle = origins[origins.shape[0] // 2]
        near = np.hypot(*(self._fixed_m - middle).T) < self.settings.laser.range_max_m + 2.0
        surfaces_of, landmarks_of = self._fixed_surfaces[near], self._fixed_landmarks[near]
        fixed, chords = circle_hits(origins, directions, self._fixed_m[near], self._fixed_radii_m[near])
        leaves = surfaces_of == Surface.BUSH
        if np.any(leaves):
            depth: FloatArray = rng.exponential(BUSH_DEPTH_M, size=fixed.shape[:1])
            depth[rng.random(fixed.shape[0]) < BUSH_GAP_SHARE] = np.inf
            capped = np.minimum(depth[:, None], chords[:, leaves])
            fixed[:, leaves] += np.where(np.isinf(depth)[:, None], np.inf, capped)
        walls = wall_hits(origins, directions, self._park.wall_starts_m, self._park.wall_ends_m)
        walkers = self._people.circles_m(time_s[[0, -1]], body_m[[0, -1]])
        along = np.linspace(0.0, 1.0, time_s.size)[:, None, None]
        walkers_m = walkers[0] + along * (walkers[1] - walkers[0])
        people, _ = circle_hits(origins, directions, walkers_m, self._people.radii_m)
        hits = np.concatenate((fixed, walls, people, np.full((fixed.shape[0], 1), np.inf)), axis=1)
        kinds = np.concatenate(
            (
                surfaces_of,
                np.full(walls.shape[1], Surface.WALL),
                np.full(people.shape[1], Surface.PERSON),
                [Surface.NOTHING],
            )
        )
        owners = np.concatenate((landmarks_of, np.full(walls.shape[1] + people.shape[1] + 1, -1)))
        first = np.argmin(hits, axis=1)
        ranges = np.take_along_axis(hits, first[:, None], axis=1)[:, 0]
        missed = ~np.isfinite(ranges)
        first[missed] = hits.shape[1] - 1
        return ranges, kinds[first], owners[first]


def _fixed_circles(park: Park) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    landmarks, blobs = park.radii_m.size, park.blob_radii_m.size
    surfaces = np.full(landmarks + blobs, int(Surface.BUSH))
    surfaces[: park.poles] = Surface.POLE
    surfaces[park.poles : landmarks] = Surface.TREE
    numbers = np.concatenate((np.arange(landmarks), np.full(blobs, -1)))
    return (
        np.vstack((park.landmarks_m, park.blobs_m)),
        np.concatenate((park.radii_m, park.blob_radii_m)),
        surfaces,
        numbers,
    )


def _mixed(ranges: FloatArray, rng: np.random.Generator, share: float) -> FloatArray:
    """The laser's spot is wider than a ray: on the edge of a thing it falls on what is behind as well."""
    mixed = ranges.copy()
    draws, parts = rng.random(ranges.shape), rng.random(ranges.shape)
    for neighbour in (np.roll(ranges, 1), np.roll(ranges, -1)):
        with np.errstate(invalid="ignore"):
            edge = np.isfinite(neighbour) & (neighbour - ranges > MIXED_JUMP_M) & (draws < share)
        mixed[edge] = ranges[edge] + parts[edge] * (neighbour[edge] - ranges[edge])
    mixed[0], mixed[-1] = ranges[0], ranges[-1]
    return mixed
