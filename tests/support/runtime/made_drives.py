"""Drives made for the tests: wheel counts and the laser's motion from a known path, with or without real scans."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, Scan, WheelCounts, uniform_bearings
from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, WorldSettings
from drivers.simulated.world.places.world import World
from runtime.calibrate.dead_reckoning import DeadReckoning, dead_reckoning, seen_by_laser
from runtime.calibrate.drive_data import CalibrationStart, DriveData
from runtime.calibrate.scans.laser_motion import LaserMotion
from slam.pose import Pose2, composed, inverted

START = CalibrationStart(body_from_laser=Pose2(0.3, 0.0, 0.0))
BOOT_NS = 5_000_000_000_000
COUNTS_PER_REV = 4096.0


@dataclass(frozen=True)
class Rover:
    """The truth: radii, tread, mount and latency that a calibration has to find; noise that it has to measure."""

    radius_left_m: float = 0.125
    radius_right_m: float = 0.125
    tread_m: float = 0.5
    mount: tuple[float, float, float] = (0.3, 0.0, 0.0)
    latency_s: float = 0.0
    slip: float = 0.01
    range_noise_m: float = 0.015

    @property
    def values(self) -> FloatArray:
        """In the order of the differential model's parameters."""
        return np.array((self.radius_left_m, self.radius_right_m, self.tread_m, *self.mount, self.latency_s))

    @property
    def named(self) -> dict[str, float]:
        """By the names of the result."""
        names = ("wheel_radius_left_m", "wheel_radius_right_m", "tread_m", "laser_x_m", "laser_y_m", "laser_yaw_rad")
        return {
            **dict(zip(names, self.values[:6], strict=True)),
            "laser_latency_s": self.latency_s,
            "slip_m_per_sqrt_m": self.slip,
            "range_noise_m": self.range_noise_m,
        }


def random_rover(rng: np.random.Generator) -> Rover:
    """As far from what the configuration says as wear, tyre pressure and a ruler make it."""
    return Rover(
        0.125 * (1.0 + rng.normal(0.0, 0.02)),
        0.125 * (1.0 + rng.normal(0.0, 0.02)),
        0.5 * (1.0 + rng.normal(0.0, 0.03)),
        (0.3 + rng.normal(0.0, 0.05), rng.normal(0.0, 0.05), rng.normal(0.0, 0.05)),
        rng.uniform(-0.03, 0.08),
    )


def counted(travel_m: FloatArray, rover: Rover, rng: np.random.Generator) -> FloatArray:
    """Counts (n, 2) of wheels that really rolled travel_m (n, 2): slip, radii and whole counts as in the wheel node."""
    steps = np.diff(travel_m, axis=0)
    turned = steps + rover.slip * np.sqrt(np.abs(steps)) * rng.standard_normal(steps.shape)
    totals = np.vstack((np.zeros((1, 2)), np.cumsum(turned, axis=0)))
    radii = np.array((rover.radius_left_m, rover.radius_right_m))
    return np.floor(totals / (2.0 * np.pi * radii) * COUNTS_PER_REV)


def wheel_counts(times_s: FloatArray, counts: FloatArray) -> tuple[WheelCounts, ...]:
    """Samples at times since the boot."""
    return tuple(
        WheelCounts(BOOT_NS + round(time * 1e9), float(left), float(right))
        for time, (left, right) in zip(times_s, counts, strict=True)
    )


def park_drive(
    seed: int, rover: Rover, duration_s: float, scan_period_s: float = 0.25, course_scale: float = 1.0
) -> DriveData:
    """Scans and counts of the simulated park, people and all; 10 scans a second at rest, fewer then to save time."""
    rng = np.random.default_rng([seed, 77])
    laser = LaserGeometrySettings(body_from_laser=rover.mount, sigma_range_m=rover.range_noise_m)
    drive = DriveSettings(tread_m=rover.tread_m, course_scale=course_scale)
    world = World(WorldSettings(seed=seed, drive=drive, laser=laser))
    times = np.arange(0.0, duration_s, 0.02)
    travel = np.array([world.wheel_travel_m(round(time * 1e9)) for time in times])
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    scans = []
    for time in (*np.arange(0.05, 2.2, 0.1), *np.arange(2.25, duration_s - 0.2, scan_period_s)):
        ranges = world.ranges_at(round(time * 1e9)).astype(np.float32)
        ranges[~np.isfinite(ranges)] = np.nan
        stamp_ns = BOOT_NS + round((time + rover.latency_s) * 1e9)
        scans.append(Scan(stamp_ns, ranges, bearings, laser.beam_period_s, 0, laser.range_max_m))
    return DriveData(f"park {seed}", tuple(scans), wheel_counts(times, counted(travel, rover, rng)))


def weaving(duration_s: float, speed_mps: float = 0.5, turn_radps: float = 0.6) -> DeadReckoning:
    """The truth of a drive that starts after two seconds, weaves left and right and goes straight between."""
    times = np.arange(0.0, duration_s, 0.02)
    speed = speed_mps * np.clip((times - 2.0) / 1.5, 0.0, 1.0)
    wave = np.sin(2.0 * np.pi * (times - 2.0) / 12.0)
    turning = turn_radps * np.sign(wave) * np.clip((np.abs(wave) - 0.5) * 4.0, 0.0, 1.0) * (times > 3.5)
    distances = np.concatenate(((0.0,), np.cumsum(0.02 * speed[1:])))
    headings = np.concatenate(((0.0,), np.cumsum(0.02 * turning[1:])))
    return dead_reckoning(times, distances, headings)


def wheel_travel_m(path: DeadReckoning, tread_m: float) -> FloatArray:
    """What both wheels roll on it, (n, 2)."""
    half = 0.5 * tread_m * path.poses[:, 2]
    return np.stack((path.distances_m - half, path.distances_m + half), axis=-1)


def made_motion(
    path: DeadReckoning, rover: Rover, rng: np.random.Generator, match_m: float = 0.003, match_rad: float = 0.0004
) -> LaserMotion:
    """What matching would find on the path, every second, with Gaussian errors: the solver alone is tested so."""
    counts = counted(wheel_travel_m(path, rover.tread_m), rover, rng)
    drive = DriveData("made", (), wheel_counts(path.times_s, counts))
    ends = np.arange(1.0, path.times_s[-1] - 1.0, 1.0)
    poses = path.at(ends)
    body = composed(inverted(poses[:-1]), poses[1:])
    deviations = np.array((match_m, match_m, match_rad))
    means = seen_by_laser(body, np.array(rover.mount)) + deviations * rng.standard_normal((len(body), 3))
    stamps = ends + rover.latency_s
    covariances = np.broadcast_to(np.diag(deviations**2), (len(body), 3, 3))
    return LaserMotion(drive.wheel_series(), np.stack((stamps[:-1], stamps[1:]), axis=-1), means, covariances, 0)
