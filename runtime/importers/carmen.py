"""CARMEN logs, the text format of the Radish and Freiburg archives, as the same arrays that other sets come in.

Messages: ODOM x y theta tv rv accel time host logger_time; FLASER n ranges x y theta odom_x odom_y odom_theta time
host logger_time; ROBOTLASER1 type start fov resolution range_max accuracy mode n ranges m remissions, laser pose, robot
pose, tv rv and three safety numbers, time host logger_time. Others are passed over.
"""

import gzip
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import DataSetError
from runtime.evaluate.rows import relative_poses
from runtime.importers.archive import Archive

SUFFIXES = (".log", ".clf", ".carmen", ".gz")
SICK_NO_RETURN_M = 80.0  # from here on the SICK's readings are codes, not distances
SAME_M = 1e-4  # logs are written with five or six decimals


@dataclass(slots=True)
class _Lines:
    """What was gathered from the lines so far."""

    odom_t: list[float] = field(default_factory=list)
    odom_pose: list[list[float]] = field(default_factory=list)
    scan_t: list[float] = field(default_factory=list)
    ranges: list[list[float]] = field(default_factory=list)
    laser_pose: list[list[float]] = field(default_factory=list)
    scan_odom_pose: list[list[float]] = field(default_factory=list)
    angles: tuple[float, float] | None = None
    range_max_m: float | None = None


def is_carmen(source: Path) -> bool:
    """Whether a source looks like a CARMEN log by its name."""
    return source.is_file() and source.suffix in SUFFIXES


def load_carmen(source: Path) -> Archive:
    """Read a log, also compressed by gzip. Raises DataSetError with the line that cannot be read."""
    lines = _Lines()
    try:
        with gzip.open(source, "rt") if source.suffix == ".gz" else source.open() as stream:
            _read(stream, lines, source)
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise DataSetError(f"{source} cannot be read as a CARMEN log ({error}); fetch it again") from error
    if not lines.scan_t:
        raise DataSetError(f"{source} holds no scan (no FLASER, no ROBOTLASER1 line); nothing was written")
    return _archive(lines, source)


def _read(stream: Iterable[str], lines: _Lines, source: Path) -> None:
    for number, line in enumerate(stream, start=1):
        words = line.split()
        try:
            match words[:1]:
                case ["ODOM"]:
                    lines.odom_pose.append([float(word) for word in words[1:4]])
                    lines.odom_t.append(float(words[-1]))
                case ["FLASER"]:
                    _front_laser(words, lines)
                case ["ROBOTLASER1"]:
                    _robot_laser(words, lines)
        except (ValueError, IndexError) as error:
            raise DataSetError(f"{source}:{number}: {words[0]} line cannot be read ({error})") from error


def _front_laser(words: list[str], lines: _Lines) -> None:
    beams = int(words[1])
    rest = words[2 + beams :]
    increment = math.pi / (beams if beams % 2 == 0 else beams - 1)  # 180 beams end one short of 90 deg, 181 at it
    _add_scan(lines, words[2 : 2 + beams], rest[0:3], rest[3:6], rest[-1], (-0.5 * math.pi, increment))


def _robot_laser(words: list[str], lines: _Lines) -> None:
    start, resolution, range_max = float(words[2]), float(words[4]), float(words[5])
    beams = int(words[8])
    rest = words[9 + beams :]
    rest = rest[1 + int(rest[0]) :]
    lines.range_max_m = range_max
    _add_scan(lines, words[9 : 9 + beams], rest[0:3], rest[3:6], rest[-1], (start, resolution))


def _add_scan(
    lines: _Lines, ranges: list[str], laser: list[str], robot: list[str], time: str, angles: tuple[float, float]
) -> None:
    if lines.angles is None:
        lines.angles = angles
    elif lines.angles != angles:
        raise ValueError("another laser or number of beams than before; split the log")
    if len(laser) + len(robot) < 6:
        raise ValueError("the line ends early")
    stamp_s = float(time)
    if lines.scan_t and stamp_s <= lines.scan_t[-1]:
        return  # some logs hold a scan twice
    lines.ranges.append([float(word) for word in ranges])
    lines.laser_pose.append([float(word) for word in laser])
    lines.scan_odom_pose.append([float(word) for word in robot])
    lines.scan_t.append(stamp_s)


def _archive(lines: _Lines, source: Path) -> Archive:
    assert lines.angles is not None
    ranges = np.array(lines.ranges, np.float32)
    laser, robot = np.array(lines.laser_pose), np.array(lines.scan_odom_pose)
    arrays: dict[str, Any] = {"scan_t": np.array(lines.scan_t), "ranges": ranges, "scan_odom_pose": robot}
    if lines.odom_t:
        order = np.argsort(lines.odom_t, kind="stable")
        arrays |= {"odom_t": np.array(lines.odom_t)[order], "odom_pose": np.array(lines.odom_pose)[order]}
    else:
        arrays |= {"odom_t": arrays["scan_t"], "odom_pose": robot}
    meta = {
        "name": f"carmen {source.name}",
        "angle_min": lines.angles[0],
        "angle_increment": lines.angles[1],
        "range_max": lines.range_max_m or min(SICK_NO_RETURN_M, float(ranges[np.isfinite(ranges)].max(initial=0.0))),
    }
    mount = relative_poses(robot, laser)
    if np.abs(mount - mount[0]).max() > SAME_M:  # not the mount: the log was corrected by someone's SLAM
        arrays |= {"gt_t": arrays["scan_t"], "gt_xy": laser[:, :2], "gt_theta": laser[:, 2]}
        meta["gt_kind"] = "poses that the log gives for the laser: another SLAM's estimate, not independent truth"
    return Archive(str(meta["name"]), source, arrays, meta)
