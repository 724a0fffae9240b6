"""A front end taken for a drive through the simulated park, with the truth about everything it saw."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, Scan, uniform_bearings
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.world import LabelledSweep, World
from slam.front_end.deskew import Twist
from slam.front_end.front_ends import FrontEnd, make_front_end
from slam.observations import Features
from slam.pose import Pose2, wrap_rad
from slam.settings.front_end import FrontEndSettings

PERIOD_NS = 100_000_000
MIDDLE_BEAM = 540


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One scan with what the front end made of it and what was really there."""

    scan: Scan
    sweep: LabelledSweep
    map_from_laser: Pose2
    at_rest: bool
    features: Features
    verdicts: NDArray[np.uint8]
    walking: NDArray[np.bool_]

    @property
    def points_m(self) -> FloatArray:
        """(k, 2) features in the map, through the true pose."""
        ranges, bearings = self.features.ranges_m, self.features.bearings_rad
        return self.map_from_laser.transform(np.stack((ranges * np.cos(bearings), ranges * np.sin(bearings)), axis=-1))

    @property
    def surfaces(self) -> NDArray[np.int64]:
        """(k,) what each feature is on."""
        return self.sweep.surfaces[self.features.beams]

    @property
    def landmarks(self) -> NDArray[np.int64]:
        """(k,) true landmark under each feature, -1 elsewhere."""
        return self.sweep.landmarks[self.features.beams]


def scan_of(world: World, start_ns: int) -> tuple[Scan, LabelledSweep]:
    """The scan, stamped at its middle beam, and the truth of the sweep that starts at start_ns."""
    laser = world.settings.laser
    sweep = world.sweep_at(start_ns)
    ranges = np.where(np.isfinite(sweep.ranges_m), sweep.ranges_m, np.nan).astype(np.float32)
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    stamp_ns = start_ns + round(MIDDLE_BEAM * laser.beam_period_s * 1e9)
    return Scan(stamp_ns, ranges, bearings, laser.beam_period_s, MIDDLE_BEAM, laser.range_max_m), sweep


def true_twist(world: World, stamp_ns: int) -> Twist:
    """What the wheels say over 40 ms around the stamp."""
    before, after = world.wheel_travel_m(stamp_ns - 20_000_000), world.wheel_travel_m(stamp_ns + 20_000_000)
    left, right = after[0] - before[0], after[1] - before[1]
    return Twist(0.5 * (left + right) / 0.04, 0.0, (right - left) / world.settings.drive.tread_m / 0.04)


def drive(
    world_settings: WorldSettings,
    settings: FrontEndSettings,
    seconds: float,
    *,
    difference: bool = True,
    sparse: bool = True,
    tread_error: float = 0.0,
    scale_error: float = 0.0,
) -> list[Look]:
    """Every scan of the first seconds; odometry integrates wheels whose tread and radius are known wrongly."""
    world = World(world_settings)
    mount = Pose2(*world_settings.laser.body_from_laser)
    front_end: FrontEnd = make_front_end(settings, difference=difference, sparse=sparse, body_from_laser=mount)
    odometry, travelled = Pose2(), (0.0, 0.0)
    looks = []
    for start_ns in range(0, int(seconds * 1e9), PERIOD_NS):
        scan, sweep = scan_of(world, start_ns)
        left, right = world.wheel_travel_m(scan.stamp_ns)
        distance = 0.5 * (left - travelled[0] + right - travelled[1]) * (1.0 + scale_error)
        turn = (right - travelled[1] - left + travelled[0]) / world_settings.drive.tread_m / (1.0 + tread_error)
        step = Pose2(distance * math.cos(0.5 * turn), distance * math.sin(0.5 * turn), turn)
        odometry, travelled = odometry @ step, (left, right)
        twist = true_twist(world, scan.stamp_ns)
        at_rest = twist.speed_mps == 0.0 and twist.yaw_rate_radps == 0.0
        features, verdicts = front_end.observe(scan, odometry, twist, at_rest)
        true_pose = Pose2(*world.map_from_body(scan.stamp_ns))
        walking = walkers(world, scan, sweep, true_pose @ mount)
        looks.append(Look(scan, sweep, true_pose @ mount, at_rest, features, verdicts, walking))
    return looks


def walkers(world: World, scan: Scan, sweep: LabelledSweep, map_from_laser: Pose2) -> NDArray[np.bool_]:
    """(n,) True for beams on somebody who gets more than 0.6 m further within a second."""
    count = world.settings.people
    walking = np.zeros(scan.ranges_m.shape, dtype=np.bool_)
    on_people = np.flatnonzero(sweep.surfaces == 5)
    if count == 0 or on_people.size == 0:
        return walking
    times = scan.stamp_ns * 1e-9 + np.array((-0.5, 0.0, 0.5))
    circles = world._people.circles_m(times, world.path.poses(times)[0])
    middles = 0.5 * (circles[:, :count] + circles[:, count:])
    speeds = np.hypot(*(middles[2] - middles[0]).T)
    ranges, bearings = sweep.ranges_m[on_people], scan.bearings_rad[on_people]
    points = map_from_laser.transform(np.stack((ranges * np.cos(bearings), ranges * np.sin(bearings)), axis=-1))
    owners = np.argmin(np.hypot(*(points[:, None] - circles[1]).transpose(2, 0, 1)), axis=1) % count
    walking[on_people] = speeds[owners] > 0.6
    return walking


def errors_of_landmarks(world: World, looks: list[Look]) -> tuple[FloatArray, FloatArray]:
    """(m,) normalised squared errors (2 degrees of freedom) and (m,) errors m of all features on true landmarks."""
    true = world.landmarks().positions_m
    squares, distances = [], []
    for look in looks:
        in_laser = look.map_from_laser.inverse().transform(true)
        for feature, landmark in enumerate(look.landmarks):
            if landmark >= 0:
                x, y = in_laser[landmark]
                range_error = look.features.ranges_m[feature] - math.hypot(x, y)
                bearing_error = wrap_rad(look.features.bearings_rad[feature] - math.atan2(y, x))
                error = np.array((range_error, bearing_error))
                squares.append(error @ np.linalg.solve(look.features.covariances[feature], error))
                distances.append(math.hypot(range_error, math.hypot(x, y) * bearing_error))
    return np.array(squares), np.array(distances)


def found_again(looks: list[Look], later: int, within_m: float, world: World) -> tuple[float, float]:
    """Shares of licensed features found again `later` scans on: of all, and of those on trunks still in view."""
    hits, total, seen_hits, seen = 0, 0, 0, 0
    for now, then in zip(looks[:-later], looks[later:], strict=True):
        if now.at_rest or len(then.features) == 0:
            continue
        points, again = now.points_m, then.points_m
        visible = set(then.sweep.landmarks.tolist()) - {-1}
        for feature in np.flatnonzero(now.features.may_create):
            hit = bool(np.hypot(*(again - points[feature]).T).min() < within_m)
            hits, total = hits + hit, total + 1
            if now.landmarks[feature] in visible:
                seen_hits, seen = seen_hits + hit, seen + 1
    return hits / total, seen_hits / seen
