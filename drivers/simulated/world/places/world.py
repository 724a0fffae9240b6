"""The simulated world: a pure function of its settings and of the time since it began.

Two processes that hold the same settings agree on everything in it, bit for bit.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from drivers.measurements import FloatArray, IntArray
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.people import People
from drivers.simulated.world.places.park import Park
from drivers.simulated.world.places.planting import planted
from drivers.simulated.world.ray_casting import as_stepped, beams, beams_about_mount, circles_met, wall_hits
from drivers.simulated.world.rover_path import RoverPath
from drivers.simulated.world.sweep_errors import as_measured

NANOSECOND_S = 1e-9
BUSH_DEPTH_M = 0.08
BUSH_GAP_SHARE = 0.15


class Surface(IntEnum):
    """What a beam fell on."""

    NOTHING = 0
    POLE = 1
    TREE = 2
    BUSH = 3
    WALL = 4
    PERSON = 5
    DOOR = 6
    GLASS = 7


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Posts and trunks as they really stand: positions_m (l, 2) of their centres in the map, radii_m (l,)."""

    positions_m: FloatArray
    radii_m: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LabelledSweep:
    """One sweep with the truth about it: ranges_m (n,) inf = nothing; surfaces (n,) Surface;
    landmarks (n,) index into Landmarks, -1 elsewhere."""

    ranges_m: FloatArray
    surfaces: IntArray
    landmarks: IntArray


class World:
    """A park with people and one rover in it."""

    def __init__(self, settings: WorldSettings, path: RoverPath | None = None) -> None:
        """path: another way through the same park than the settings say."""
        self.settings = settings
        self.path = RoverPath(settings.drive) if path is None else path
        rng = np.random.default_rng([settings.seed, 0])
        self._park = planted(settings, self.path.course, rng)
        corners = self.path.course.points_m(np.arange(0.0, self.path.course.length_m, 0.1))
        low, high = corners.min(axis=0) - settings.margin_m, corners.max(axis=0) + settings.margin_m
        self._people = People(settings.people, self.path.course, low, high, rng)
        circles = _fixed_circles(self._park)
        self._fixed_m, self._fixed_radii_m, self._fixed_surfaces, self._fixed_landmarks = circles
        laser = settings.laser
        self._bearings_rad, self._delays_s = beams_about_mount(laser)

    def landmarks(self) -> Landmarks:
        """What a perfect map would hold."""
        return Landmarks(self._park.landmarks_m.copy(), self._park.radii_m.copy())

    def clearance_m(self, points_m: FloatArray) -> float:
        """Distance from points (n, 2) to the nearest thing that stands in the park; below zero inside one."""
        to_circles = np.hypot(*(points_m[:, None] - self._fixed_m).transpose(2, 0, 1)) - self._fixed_radii_m
        starts, spans = self._park.wall_starts_m, self._park.wall_ends_m - self._park.wall_starts_m
        offsets = points_m[:, None] - starts
        share = np.clip((offsets * spans).sum(axis=-1) / np.maximum((spans**2).sum(axis=-1), 1e-9), 0.0, 1.0)
        to_walls = np.hypot(*(offsets - share[..., None] * spans).transpose(2, 0, 1))
        return float(min(to_circles.min(initial=np.inf), to_walls.min(initial=np.inf)))

    def map_from_body(self, t_ns: int) -> tuple[float, float, float]:
        """x m, y m, heading rad (unwrapped) of the body in the map; (0, 0, 0) at the start."""
        points, headings = self.path.poses(np.array([t_ns * NANOSECOND_S]))
        return float(points[0, 0]), float(points[0, 1]), float(headings[0])

    def wheel_travel_m(self, t_ns: int) -> tuple[float, float]:
        """How far the left and the right wheel have rolled since the world began, m, forward positive."""
        left, right = self.path.wheel_travel_m(np.array([t_ns * NANOSECOND_S]))
        return float(left[0]), float(right[0])

    def ranges_at(self, t_ns: int) -> FloatArray:
        """(beam_count,) m of the sweep whose step 0 is measured at t_ns; inf where nothing came back."""
        return self.sweep_at(t_ns).ranges_m

    def sweep_at(self, t_ns: int) -> LabelledSweep:
        """The same with what each beam fell on, in the order of the steps; each beam is cast at its own time."""
        laser = self.settings.laser
        rng = np.random.default_rng([self.settings.seed, 1, abs(t_ns)])
        time_s: FloatArray = t_ns * NANOSECOND_S + self._delays_s
        body_m, heading = self.path.poses(time_s)
        origins, directions = beams(body_m, heading, laser.body_from_laser, self._bearings_rad)
        ranges, surfaces, landmarks = self._cast(time_s, body_m, origins, directions, rng)
        ranges = as_measured(ranges, laser, rng)
        lost = np.isinf(ranges)
        surfaces[lost] = Surface.NOTHING
        landmarks[lost] = -1
        return LabelledSweep(as_stepped(laser, ranges), as_stepped(laser, surfaces), as_stepped(laser, landmarks))

    def _cast(
        self,
        time_s: FloatArray,
        body_m: FloatArray,
        origins: FloatArray,
        directions: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, IntArray, IntArray]:
        count = time_s.size
        walkers_m = self._people.circles_m(time_s[[0, -1]], body_m[[0, -1]])
        fixed_m = self._fixed_m
        fixed, chords, rays, circles = circles_met(origins, directions, fixed_m, fixed_m, self._fixed_radii_m)
        depth: FloatArray = rng.exponential(BUSH_DEPTH_M, size=(count,))
        depth[rng.random(count) < BUSH_GAP_SHARE] = np.inf
        leaves = self._fixed_surfaces[circles] == Surface.BUSH
        through = depth[rays[leaves]]
        fixed[leaves] += np.where(np.isinf(through), np.inf, np.minimum(through, chords[leaves]))
        from_m, to_m = walkers_m
        people, _, people_rays, _ = circles_met(origins, directions, from_m, to_m, self._people.radii_m)
        walls = wall_hits(origins, directions, self._park.wall_starts_m, self._park.wall_ends_m)
        wall_rays = np.repeat(np.arange(count), walls.shape[1])

        distances = np.concatenate((fixed, people, walls.ravel()))
        of_rays = np.concatenate((rays, people_rays, wall_rays))
        kinds = np.concatenate(
            (
                self._fixed_surfaces[circles],
                np.full(people.size, Surface.PERSON),
                np.full(wall_rays.size, Surface.WALL),
            )
        )
        owners = np.concatenate((self._fixed_landmarks[circles], np.full(people.size + wall_rays.size, -1)))
        nearest_last = np.lexsort((-distances, of_rays))
        ranges = np.full(count, np.inf)
        surfaces, landmarks = np.full(count, int(Surface.NOTHING)), np.full(count, -1)
        ranges[of_rays[nearest_last]] = distances[nearest_last]
        surfaces[of_rays[nearest_last]] = kinds[nearest_last]
        landmarks[of_rays[nearest_last]] = owners[nearest_last]
        missed = np.isinf(ranges)
        surfaces[missed], landmarks[missed] = Surface.NOTHING, -1
        return ranges, surfaces, landmarks


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
