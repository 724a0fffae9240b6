"""Trajectories as arrays and as TUM files, which evo and others read: one line "time x y z qx qy qz qw" a pose."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.errors import ConfigurationError
from slam.pose import rotated, wrap_rads


def tum_text(trajectory: FloatArray) -> str:
    """Rows (n, 4) of t s, x m, y m, heading rad as the text of a TUM file."""
    return "".join(
        f"{t:.9f} {x:.9f} {y:.9f} 0 0 0 {math.sin(0.5 * heading):.12f} {math.cos(0.5 * heading):.12f}\n"
        for t, x, y, heading in trajectory.tolist()
    )


def read_tum(path: Path) -> FloatArray:
    """Rows (n, 4) of t s, x m, y m, heading rad. Raises ConfigurationError with the line that cannot be read."""
    rows = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} cannot be read as a trajectory ({error}); give a TUM file") from error
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            t, x, y, _, qx, qy, qz, qw = map(float, words)
        except ValueError as error:
            expected = "expected 8 numbers 't x y z qx qy qz qw'"
            raise ConfigurationError(f"{path}:{number}: {expected}, got {line!r}") from error
        rows.append((t, x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))))
    if not rows:
        raise ConfigurationError(f"{path} holds no pose; give a TUM file with one pose a line")
    return np.array(rows)


def poses_at(trajectory: FloatArray, times_s: FloatArray) -> FloatArray:
    """Poses (n, 3) of a trajectory (k, 4) at times (n,), linear between its rows; NaN outside of it."""
    outside = (times_s < trajectory[0, 0]) | (times_s > trajectory[-1, 0])
    poses = np.column_stack(
        [
            np.interp(times_s, trajectory[:, 0], trajectory[:, 1]),
            np.interp(times_s, trajectory[:, 0], trajectory[:, 2]),
            wrap_rads(np.interp(times_s, trajectory[:, 0], np.unwrap(trajectory[:, 3]))),
        ]
    )
    poses[outside] = np.nan
    return poses


def nearest_rows(trajectory: FloatArray, times_s: FloatArray, within_s: float) -> NDArray[np.int64]:
    """Index (n,) of the row nearest in time, -1 where none lies within."""
    times = trajectory[:, 0]
    after = np.clip(np.searchsorted(times, times_s), 1, len(times) - 1)
    nearest = np.where(times_s - times[after - 1] <= times[after] - times_s, after - 1, after)
    close: NDArray[np.int64] = np.where(np.abs(times[nearest] - times_s) <= within_s, nearest, -1)
    return close


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """first^-1 (+) second, row by row, (n, 3)."""
    moved = rotated(second[:, :2] - first[:, :2], -first[:, 2])
    return np.column_stack((moved, wrap_rads(second[:, 2] - first[:, 2])))
