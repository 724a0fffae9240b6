"""Wheel samples of every kind as columns, which is how a message holds them."""

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, OdometryPose, SpeedSteering, SpeedYawRate, WheelCounts, WheelSample

COUNTS, SPEED_STEERING, SPEED_YAW_RATE, ODOMETRY_POSE = 0, 1, 2, 3  # as infant_msgs/Tick names them
INVALID, VALID, UNBROKEN = 0.0, 1.0, 2.0  # third value of counts; records before UNBROKEN was known never hold it


def wheel_columns(wheels: tuple[WheelSample, ...]) -> tuple[NDArray[np.uint8], NDArray[np.int64], FloatArray]:
    """Kinds (n,), stamps (n,) and values (3 n,) of the samples."""
    kinds: list[int] = []
    stamps_ns: list[int] = []
    values: list[float] = []
    for sample in wheels:
        stamps_ns.append(sample.stamp_ns)
        match sample:
            case WheelCounts():
                kinds.append(COUNTS)
                good = UNBROKEN if sample.unbroken else VALID
                values += (sample.left, sample.right, good if sample.valid else INVALID)
            case SpeedSteering():
                kinds.append(SPEED_STEERING)
                values += (sample.speed_mps, sample.steering_rad, 0.0)
            case SpeedYawRate():
                kinds.append(SPEED_YAW_RATE)
                values += (sample.speed_mps, sample.yaw_rate_radps, 0.0)
            case OdometryPose():
                kinds.append(ODOMETRY_POSE)
                values += (sample.x_m, sample.y_m, sample.heading_rad)
    return np.array(kinds, np.uint8), np.array(stamps_ns, np.int64), np.array(values, np.float64)


def wheel_samples(
    kinds: NDArray[np.uint8], stamps_ns: NDArray[np.int64], values: FloatArray
) -> tuple[WheelSample, ...]:
    """Back again. Raises ValueError on a kind that this release does not know."""
    columns = values.reshape(-1, 3).tolist()
    return tuple(
        _wheel(kind, stamp_ns, *column)
        for kind, stamp_ns, column in zip(kinds.tolist(), stamps_ns.tolist(), columns, strict=True)
    )


def _wheel(kind: int, stamp_ns: int, first: float, second: float, third: float) -> WheelSample:
    if kind == COUNTS:
        return WheelCounts(stamp_ns, first, second, third != INVALID, third == UNBROKEN)
    if kind == SPEED_STEERING:
        return SpeedSteering(stamp_ns, first, second)
    if kind == SPEED_YAW_RATE:
        return SpeedYawRate(stamp_ns, first, second)
    if kind == ODOMETRY_POSE:
        return OdometryPose(stamp_ns, first, second, third)
    raise ValueError(f"wheel sample of unknown kind {kind}")
