"""Trajectories as arrays and as TUM files, which evo and others read: one line "time x y z qx qy qz qw" a pose."""

import math
from pathlib import Path

import numpy as np

from drivers.measurements import FloatArray
from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError
from slam.pose import rotated, wrap_rads

LONGEST_GAP_S = 10.0  # between two rows farther apart anything may have happened: a part of the record is gone
LARGEST_BYTES = 64 << 20  # a million poses
LARGEST = 1e10  # seconds or metres: no clock and no place is beyond
ROUNDING_S = 1e-6  # a float of seconds since 1970 is that coarse


def tum_text(trajectory: FloatArray) -> str:
    """Rows (n, 4) of t s, x m, y m, heading rad as the text of a TUM file."""
    return "".join(
        f"{t:.9f} {x:.9f} {y:.9f} 0 0 0 {math.sin(0.5 * heading):.12f} {math.cos(0.5 * heading):.12f}\n"
        for t, x, y, heading in trajectory.tolist()
    )


def read_tum(path: Path) -> FloatArray:
    """Rows (n, 4) of t s, x m, y m, heading rad; a pose that is NaN is not known.

    Raises ConfigurationError with the line that cannot be read.
    """
    rows: list[tuple[float, float, float, float]] = []
    try:
        lines = read_bounded(path, LARGEST_BYTES).decode().splitlines()
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path} cannot be read as a trajectory ({error}); give a TUM file") from error
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            t, x, y, _, qx, qy, qz, qw = map(float, words)
        except ValueError as error:
            expected = "expected 8 numbers 't x y z qx qy qz qw'"
            raise ConfigurationError(f"{path}:{number}: {expected}, got {line[:200]!r}") from error
        if not abs(t) < LARGEST or abs(x) > LARGEST or abs(y) > LARGEST:
            raise ConfigurationError(f"{path}:{number}: expected seconds and metres, got {line[:200]!r}")
        if rows and t <= rows[-1][0]:
            before = rows[-1][0]
            raise ConfigurationError(f"{path}:{number}: {t:.9f} s is not after {before:.9f} s; sort the poses by time")
        rows.append((t, x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))))
    if not rows:
        raise ConfigurationError(f"{path} holds no pose; give a TUM file with one pose per line")
    return np.array(rows)


def poses_at(trajectory: FloatArray, times_s: FloatArray) -> FloatArray:
    """Poses (n, 3) of a trajectory (k, 4) at times (n,), linear between its rows; NaN outside of it and in its gaps."""
    times = trajectory[:, 0]
    after = np.clip(np.searchsorted(times, times_s), 1, max(1, len(times) - 1))
    inside = (times_s >= times[0] - ROUNDING_S) & (times_s <= times[-1] + ROUNDING_S)
    if len(times) > 1:
        on_a_row = (times[after] == times_s) | (times[after - 1] == times_s)
        inside &= on_a_row | (times[after] - times[after - 1] <= LONGEST_GAP_S)
    columns = (trajectory[:, 1], trajectory[:, 2], np.unwrap(trajectory[:, 3]))
    poses = np.column_stack([np.interp(times_s, times, column) for column in columns])
    poses[:, 2] = wrap_rads(poses[:, 2])
    poses[~inside] = np.nan
    return poses


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """first^-1 (+) second, row by row, (n, 3)."""
    moved = rotated(second[:, :2] - first[:, :2], -first[:, 2])
    return np.column_stack((moved, wrap_rads(second[:, 2] - first[:, 2])))
