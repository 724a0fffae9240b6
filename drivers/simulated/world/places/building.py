"""A simulated building: corridors in a ring, rooms, moving doors, glass, people; a pure function of seed and time."""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, WorldSettings
from drivers.simulated.world.people import CorridorPeople
from drivers.simulated.world.places.floor_plan import RING_M, draw_floor
from drivers.simulated.world.places.world import LabelledSweep, Surface
from drivers.simulated.world.ray_casting import as_stepped, beams, beams_about_mount, circles_met, segments_met
from drivers.simulated.world.rover_path import RoverPath
from drivers.simulated.world.sweep_errors import as_measured

BUILDING_STREAM = 6  # second word of the seed, so that no park shares its numbers
LASERS: dict[int, dict[str, float]] = {  # by their beams: two Hokuyos, a small lidar that sees all round, a coarse SICK
    1081: {},
    541: {"steps_per_revolution": 720},
    360: {"steps_per_revolution": 360, "first_bearing_rad": -math.pi, "range_max_m": 12.0, "sigma_range_m": 0.02},
    181: {"steps_per_revolution": 360, "first_bearing_rad": -0.5 * math.pi, "sigma_range_m": 0.02},
}
SPEED_MPS = 0.7
BESIDE_M = (0.45, 0.8)  # people keep this far from the middle of the corridor
MIRROR_RAD = math.radians(15.0)  # glass sends beams back to the laser that fall on it within this of its normal
SHALLOW_RAD = math.radians(70.0)  # beyond this from the normal it mirrors them away
GLASS_LOSES = 0.1  # share of the beams between both that come back from neither the glass nor what is behind it


def building_settings(seed: int, beam_count: int = 1081, people: int = 8) -> WorldSettings:
    """Settings of a drive round the ring, with the laser of LASERS that has so many beams, at 10 turns a second."""
    half, depth = 0.5 * RING_M[0], RING_M[1]
    drive = DriveSettings(
        corners_m=((half, 0.0), (half, depth), (-half, depth), (-half, 0.0)), corner_m=2.0, speed_mps=SPEED_MPS
    )
    laser = LaserGeometrySettings.model_validate({"beam_count": beam_count, **LASERS[beam_count]})
    return WorldSettings(seed=seed, people=people, drive=drive, laser=laser)


class Building:
    """What the rover's laser and wheels would measure in it, with the truth about both."""

    def __init__(self, settings: WorldSettings, path: RoverPath | None = None) -> None:
        """settings: of building_settings; seed, people, laser and the speed of the drive may differ. path: another."""
        self.settings = settings
        self.path = RoverPath(settings.drive) if path is None else path
        rng = np.random.default_rng([settings.seed, BUILDING_STREAM])
        self.floor = draw_floor(rng)
        self._people = CorridorPeople(settings.people, self.path.course, BESIDE_M, rng)
        doors = len(self.floor.doors.opened(0.0))
        glass = np.concatenate((self.floor.glass, np.zeros(doors, dtype=np.bool_)))
        kinds = np.concatenate((np.full(len(self.floor.glass), Surface.WALL), np.full(doors, Surface.DOOR)))
        self._kinds: IntArray = np.where(glass, Surface.GLASS, kinds)
        laser = settings.laser
        self._bearings_rad, self._delays_s = beams_about_mount(laser)

    def map_from_body(self, t_ns: int) -> tuple[float, float, float]:
        """x m, y m, heading rad (unwrapped) of the body in the map; (0, 0, 0) at the start."""
        points, headings = self.path.poses(np.array([t_ns * 1e-9]))
        return float(points[0, 0]), float(points[0, 1]), float(headings[0])

    def wheel_travel_m(self, t_ns: int) -> tuple[float, float]:
        """How far the left and the right wheel have rolled since the drive began, m, forward positive."""
        left, right = self.path.wheel_travel_m(np.array([t_ns * 1e-9]))
        return float(left[0]), float(right[0])

    def ranges_at(self, t_ns: int) -> FloatArray:
        """(beam_count,) m of the sweep whose step 0 is measured at t_ns; inf where nothing came back."""
        return self.sweep_at(t_ns).ranges_m

    def sweep_at(self, t_ns: int) -> LabelledSweep:
        """The sweep whose step 0 is measured at t_ns; doors stand as they do in its middle."""
        laser = self.settings.laser
        rng = np.random.default_rng([self.settings.seed, BUILDING_STREAM, 1, abs(t_ns)])
        time_s: FloatArray = t_ns * 1e-9 + self._delays_s
        body_m, heading = self.path.poses(time_s)
        origins, directions = beams(body_m, heading, laser.body_from_laser, self._bearings_rad)
        ranges, surfaces = self._cast(time_s, body_m, origins, directions, rng)
        ranges = as_measured(ranges, laser, rng)
        surfaces[np.isinf(ranges)] = Surface.NOTHING
        return LabelledSweep(as_stepped(laser, ranges), as_stepped(laser, surfaces), np.full(len(ranges), -1))

    def _cast(
        self,
        time_s: FloatArray,
        body_m: FloatArray,
        origins: FloatArray,
        directions: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, IntArray]:
        floor, reach_m = self.floor, self.settings.laser.range_max_m
        hinges, edges = floor.doors.leaves_m(float(time_s[len(time_s) // 2]))
        starts, ends = np.vstack((floor.starts_m, hinges)), np.vstack((floor.ends_m, edges))
        walls, incidence, wall_rays, segments = segments_met(origins, directions, starts, ends, reach_m)
        wall_kinds = self._kinds[segments]
        through, away = _glass_fate(incidence, rng.random(len(incidence)))
        glass = wall_kinds == Surface.GLASS
        walls = np.where(glass & through, np.inf, walls)
        posts, _, post_rays, _ = circles_met(origins, directions, floor.circles_m, floor.circles_m, floor.radii_m)
        from_m, to_m = self._people.circles_m(time_s[[0, -1]], body_m[[0, -1]])
        people, _, people_rays, _ = circles_met(origins, directions, from_m, to_m, self._people.radii_m)
        distances = np.concatenate((walls, posts, people))
        rays = np.concatenate((wall_rays, post_rays, people_rays))
        kinds = np.concatenate(
            (
                np.where(glass & away, Surface.NOTHING, wall_kinds),
                np.full(len(posts), Surface.POLE),
                np.full(len(people), Surface.PERSON),
            )
        )
        ranges = np.full(len(origins), np.inf)
        np.minimum.at(ranges, rays, distances)
        surfaces = np.full(len(origins), int(Surface.NOTHING))
        nearest = (distances == ranges[rays]) & np.isfinite(distances)
        surfaces[rays[nearest]] = kinds[nearest]
        ranges[surfaces == Surface.NOTHING] = np.inf
        return ranges, surfaces


def _glass_fate(incidence_rad: FloatArray, draws: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which beams (n,) pass through a pane and which it mirrors away; the others come back from it."""
    steep, shallow = incidence_rad < MIRROR_RAD, incidence_rad > SHALLOW_RAD
    lost = ~steep & (shallow | (draws < GLASS_LOSES))
    return ~steep & ~lost, lost
