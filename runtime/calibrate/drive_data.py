"""What a calibration works on: one drive's scans and wheel samples, and the geometry believed so far."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import BoolArray, FloatArray, OdometryPose, Scan, SpeedSteering, WheelCounts
from runtime.errors import DataSetError
from slam.pose import Pose2, rotated

GAP_S = 0.5  # silence of the wheels after which the motion counts as unknown, as in slam's odometry
POSE_GAP_S = 2.0  # a base adds up its poses, whether anybody listens or not: only the way between them is not known
SMALL_RAD = 1e-6


@dataclass(frozen=True, slots=True)
class CalibrationStart:
    """Geometry from which the search begins, and the encoder's counts per turn (taken as exact).

    latency_s: how much later than the measurement its stamp is; positive where scans are stamped too late.
    """

    wheel_radius_left_m: float = 0.125
    wheel_radius_right_m: float = 0.125
    tread_m: float = 0.5
    counts_per_rev: float = 4096.0
    body_from_laser: Pose2 = field(default_factory=Pose2)
    latency_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SteeringStart:
    """The same for a vehicle with a steered axle whose speed is measured at one wheel (slam's odometry, "steered")."""

    speed_scale: float = 1.0
    steering_scale: float = 1.0
    steering_bias_rad: float = 0.0
    wheel_base_m: float = 2.83
    speed_wheel_offset_m: float = 0.76
    body_from_laser: Pose2 = field(default_factory=Pose2)
    latency_s: float = 0.0


@dataclass(frozen=True, slots=True)
class PoseStart:
    """The same for a base that hands out poses: what its distances and turns are to be multiplied by."""

    distance_scale: float = 1.0
    turn_scale: float = 1.0
    body_from_laser: Pose2 = field(default_factory=Pose2)
    latency_s: float = 0.0


Start = CalibrationStart | SteeringStart | PoseStart


@dataclass(frozen=True, slots=True, eq=False)
class WheelSeries:
    """Wheel samples of one drive as arrays: seconds (n,) since the drive's origin, values (n, 2).

    values: left and right counts, speed m/s and steering rad, or distance m and heading rad since the start.
    broken (n,): nothing is known of the motion between the sample before and this one.
    """

    times_s: FloatArray
    values: FloatArray
    broken: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class DriveData:
    """One drive, in the order of its stamps; the name appears in messages."""

    name: str
    scans: tuple[Scan, ...]
    wheels: tuple[WheelCounts, ...] | tuple[SpeedSteering, ...] | tuple[OdometryPose, ...]

    @property
    def origin_ns(self) -> int:
        """Stamp from which the drive's seconds are counted."""
        return self.wheels[0].stamp_ns

    def scan_times_s(self) -> FloatArray:
        """Stamps of the scans, (n,) seconds since the origin."""
        return np.array([(scan.stamp_ns - self.origin_ns) * 1e-9 for scan in self.scans])

    def wheel_series(self) -> WheelSeries:
        """The wheel samples as arrays; samples out of order or not finite are left out."""
        values = np.array([_values(sample) for sample in self.wheels])
        valid = np.array([not isinstance(sample, WheelCounts) or sample.valid for sample in self.wheels])
        times_s = (np.array([sample.stamp_ns for sample in self.wheels]) - self.origin_ns) * 1e-9
        usable = valid & np.isfinite(values).all(axis=1)
        newest_s = np.maximum.accumulate(np.where(usable, times_s, -np.inf))
        kept = np.flatnonzero(usable & (times_s > np.concatenate(((-np.inf,), newest_s[:-1]))))
        poses = isinstance(self.wheels[0], OdometryPose)
        silent = np.diff(times_s[kept], prepend=times_s[kept[:1]]) > (POSE_GAP_S if poses else GAP_S)
        lost = np.diff(np.cumsum(~valid)[kept], prepend=0) > 0
        told = along_arcs(values[kept]) if poses and len(kept) else values[kept]
        return WheelSeries(times_s[kept], told, silent | lost)


def _values(sample: WheelCounts | SpeedSteering | OdometryPose) -> tuple[float, ...]:
    if isinstance(sample, WheelCounts):
        return sample.left, sample.right
    if isinstance(sample, SpeedSteering):
        return sample.speed_mps, sample.steering_rad
    return sample.x_m, sample.y_m, sample.heading_rad


def along_arcs(poses: FloatArray) -> FloatArray:
    """Distance m, negative backwards, and heading rad, not wrapped, (n, 2) since the first of poses (n, 3)."""
    headings = np.unwrap(poses[:, 2])
    half = 0.5 * np.diff(headings)
    ahead, left = rotated(np.diff(poses[:, :2], axis=0), -headings[:-1]).T
    safe = np.where(np.abs(half) > SMALL_RAD, half, SMALL_RAD)
    steps = np.where(np.abs(half) > SMALL_RAD, safe / np.tan(safe), 1.0) * ahead + half * left
    return np.stack((np.concatenate(((0.0,), np.cumsum(steps))), headings - headings[0]), axis=-1)


def check_drives(drives: Sequence[DriveData]) -> None:
    """Raise DataSetError in one sentence where there is nothing to calibrate from."""
    if not drives:
        raise DataSetError("no drive given; name at least one run to calibrate from")
    for drive in drives:
        if len(drive.scans) < 2:
            raise DataSetError(
                f"{drive.name}: holds {len(drive.scans)} scans, expected at least 2; record with the laser"
            )
        kinds = {type(sample).__name__ for sample in drive.wheels}
        if len(kinds) > 1:
            raise DataSetError(
                f"{drive.name}: mixes wheel samples of kinds {sorted(kinds)}, expected one kind; import it again"
            )
        usable = len(drive.wheel_series().times_s) if drive.wheels else 0
        if usable < 2:
            raise DataSetError(
                f"{drive.name}: holds {usable} usable wheel samples, expected at least 2; record with the encoders"
            )
