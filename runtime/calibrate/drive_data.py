"""What a calibration works on: one drive's scans and wheel samples, and the geometry believed so far."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import BoolArray, FloatArray, Scan, SpeedSteering, WheelCounts
from runtime.errors import DataSetError
from slam.pose import Pose2

GAP_S = 0.5  # silence of the wheels after which the motion counts as unknown, as in slam's odometry


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


@dataclass(frozen=True, slots=True, eq=False)
class WheelSeries:
    """Wheel samples of one drive as arrays: seconds (n,) since the drive's origin, values (n, 2).

    values: left and right counts, or speed m/s and steering rad. broken (n,): nothing is known of the motion between
    the sample before and this one.
    """

    times_s: FloatArray
    values: FloatArray
    broken: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class DriveData:
    """One drive, in the order of its stamps; the name appears in messages."""

    name: str
    scans: tuple[Scan, ...]
    wheels: tuple[WheelCounts, ...] | tuple[SpeedSteering, ...]

    @property
    def origin_ns(self) -> int:
        """Stamp from which the drive's seconds are counted."""
        return self.wheels[0].stamp_ns

    def scan_times_s(self) -> FloatArray:
        """Stamps of the scans, (n,) seconds since the origin."""
        return np.array([(scan.stamp_ns - self.origin_ns) * 1e-9 for scan in self.scans])

    def wheel_series(self) -> WheelSeries:
        """The wheel samples as arrays; samples out of order or not finite are left out."""
        rows: list[tuple[float, float, float]] = []
        broken: list[bool] = []
        lost = False
        for sample in self.wheels:
            time_s = (sample.stamp_ns - self.origin_ns) * 1e-9
            if isinstance(sample, WheelCounts):
                first, second = sample.left, sample.right
                if not sample.valid:
                    lost = True
                    continue
            else:
                first, second = sample.speed_mps, sample.steering_rad
            if not (math.isfinite(first) and math.isfinite(second)) or (rows and time_s <= rows[-1][0]):
                continue
            broken.append(lost or (bool(rows) and time_s - rows[-1][0] > GAP_S))
            rows.append((time_s, first, second))
            lost = False
        table = np.array(rows).reshape(-1, 3)
        return WheelSeries(table[:, 0], table[:, 1:], np.array(broken, dtype=np.bool_))


def check_drives(drives: Sequence[DriveData]) -> None:
    """Raise DataSetError in one sentence where there is nothing to calibrate from."""
    if not drives:
        raise DataSetError("no drive given; name at least one run to calibrate from")
    for drive in drives:
        if len(drive.scans) < 2:
            raise DataSetError(
                f"{drive.name}: holds {len(drive.scans)} scans, expected at least 2; record with the laser"
            )
        if len(drive.wheels) < 2:
            raise DataSetError(
                f"{drive.name}: holds {len(drive.wheels)} wheel samples, expected at least 2; record with the encoders"
            )
        kinds = {type(sample).__name__ for sample in drive.wheels}
        if len(kinds) > 1:
            raise DataSetError(
                f"{drive.name}: mixes wheel samples of kinds {sorted(kinds)}, expected one kind; import it again"
            )
