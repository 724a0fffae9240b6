"""CARMEN logs, the text format of the Radish and Freiburg archives, as the same arrays that other sets come in.

Whatever cannot be read is left out and counted, with its line: a log that was cut off, a laser that was not connected,
a clock that was set during the drive.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import DataSetError
from runtime.evaluate.rows import relative_poses
from runtime.importers.archive import Archive
from runtime.importers.parsing import carmen_lines
from runtime.importers.parsing.carmen_lines import LaserLine
from runtime.importers.parsing.clock_steps import join_clock
from runtime.importers.parsing.left_out import LeftOut
from runtime.importers.parsing.text_lines import TextLines

SICK_NO_RETURN_M = 80.0  # from here on the SICK's readings are codes, not distances
SAME_M = 1e-4  # logs are written with five or six decimals
WORDS = ("ODOM", "FLASER", "ROBOTLASER1", "PARAM")
SCANS, ODOMETRY = "scans", "odometry samples"


@dataclass(slots=True)
class _Log:
    """What was gathered from the lines: each stamp with its line number, scans and odometry in the order of writing."""

    source: Path
    left_out: LeftOut = field(default_factory=LeftOut)
    stamps_s: list[float] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    items: list[LaserLine | list[float]] = field(default_factory=list)
    told: dict[str, float] = field(default_factory=dict)

    def place(self, number: int) -> str:
        return f"{self.source.name}:{number}"


def load_carmen(source: Path) -> Archive:
    """Read a log, also compressed by gzip, to its last whole line. Raises DataSetError where it holds no scan."""
    log, lines = _Log(source), TextLines(source)
    try:
        for number, line, is_whole in lines:
            _read(line, number, is_whole, log)
    except OSError as error:
        raise DataSetError(f"{source} cannot be read as a CARMEN log ({error}); fetch it again") from error
    if lines.damage:
        log.left_out.warnings.append(f"{source.name} is read up to its last whole line: {lines.damage}")
    return _archive(log)


def _read(line: str, number: int, is_whole: bool, log: _Log) -> None:
    words = line.split()
    if not words or words[0] not in WORDS:
        return
    what = ODOMETRY if words[0] == "ODOM" else SCANS
    try:
        _take(words, number, log)
    except (ValueError, IndexError) as error:
        if words[0] == "PARAM":
            log.left_out.warnings.append(f"{log.place(number)}: {error}; the line is passed over")
        else:
            reason = f"{words[0]} line cannot be read ({error})" if is_whole else "the log was cut off in this line"
            log.left_out.add(what, reason, log.place(number))


def _take(words: list[str], number: int, log: _Log) -> None:
    """Keep what a line says. Raises ValueError, IndexError where it cannot be read."""
    item: LaserLine | list[float]
    match words[0]:
        case "PARAM":
            carmen_lines.parameter(words, log.told)
            return
        case "ODOM":
            stamp_s, item = carmen_lines.odometry_line(words)
        case "FLASER":
            item = carmen_lines.front_laser_line(words)
            stamp_s = item.stamp_s
        case _:
            item = carmen_lines.robot_laser_line(words)
            stamp_s = item.stamp_s
    log.stamps_s.append(stamp_s)
    log.numbers.append(number)
    log.items.append(item)


def _archive(log: _Log) -> Archive:
    scans, odometry = _in_order(log)
    if not scans:
        first = log.left_out.first()
        raise DataSetError(
            f"{log.source} holds no scan that can be used (FLASER or ROBOTLASER1 lines)"
            f"{f'; {first}' if first else ''}; nothing was written"
        )
    lines = [line for _, line in scans]
    beams = max(len(line.ranges_m) for line in lines)
    ranges = np.full((len(lines), beams), np.nan, np.float32)
    for row, line in zip(ranges, lines, strict=True):
        row[: len(line.ranges_m)] = line.ranges_m
    laser, robot = (np.array([getattr(line, name) for line in lines]) for name in ("laser_pose", "robot_pose"))
    geometry = np.array([(*carmen_lines.angles(line, log.told), len(line.ranges_m)) for line in lines])
    arrays: dict[str, Any] = {
        "scan_t": np.array([stamp_s for stamp_s, _ in scans]),
        "ranges": ranges,
        "scan_odom_pose": robot,
        "scan_angle_min": geometry[:, 0],
        "scan_angle_increment": geometry[:, 1],
        "scan_beams": geometry[:, 2].astype(np.int64),
    }
    if odometry:
        arrays |= {"odom_t": np.array([stamp_s for stamp_s, _ in odometry])}
        arrays |= {"odom_pose": np.array([pose for _, pose in odometry])}
    if guessed := sum(carmen_lines.is_guessed(line, log.told) for line in lines):
        log.left_out.warnings.append(
            f"{guessed} scans of {beams} beams are taken to span 180 deg, because the log does not say; where that is "
            f"wrong, put the line 'PARAM {carmen_lines.FOV} RADIANS' at its head"
        )
    return Archive(f"carmen {log.source.name}", log.source, arrays, _meta(log, lines, arrays, laser), log.left_out)


def _meta(log: _Log, lines: list[LaserLine], arrays: dict[str, Any], laser: np.ndarray[Any, Any]) -> dict[str, Any]:
    """The description; adds the poses of another SLAM to the arrays where the log holds them."""
    ranges = arrays["ranges"]
    told_m = [line.range_max_m for line in lines if line.range_max_m is not None and line.range_max_m > 0.0]
    meta: dict[str, Any] = {
        "name": f"carmen {log.source.name}",
        "angle_min": float(arrays["scan_angle_min"][0]),
        "angle_increment": float(arrays["scan_angle_increment"][0]),
        "range_max": max(told_m) if told_m else min(SICK_NO_RETURN_M, _largest_m(ranges)),
        "vehicle": carmen_lines.mount_of(log.told, log.source),
    }
    mount = relative_poses(arrays["scan_odom_pose"], laser)
    if np.abs(mount - mount[0]).max() > SAME_M:  # not the mount: the log was corrected by someone's SLAM
        arrays |= {"gt_t": arrays["scan_t"], "gt_xy": laser[:, :2], "gt_theta": laser[:, 2]}
        meta["gt_kind"] = "poses that the log gives for the laser: another SLAM's estimate, not independent truth"
    elif np.abs(mount[0]).max() > SAME_M:
        meta["vehicle"] = dict(zip(("laser_x", "laser_y", "laser_yaw"), mount[0].round(6).tolist(), strict=True))
    return meta


def _largest_m(ranges: np.ndarray[Any, Any]) -> float:
    return float(ranges[np.isfinite(ranges)].max(initial=0.0)) or SICK_NO_RETURN_M


def _in_order(log: _Log) -> tuple[list[tuple[float, LaserLine]], list[tuple[float, list[float]]]]:
    """Scans and odometry by their time, on one clock that never goes back; each time once."""
    clock = join_clock(log.stamps_s)
    for row, step_s in clock.steps:
        where = "back" if step_s < 0.0 else "forward"
        log.left_out.warnings.append(
            f"{log.place(log.numbers[row])}: the clock of the log was set {where} by {abs(step_s):.1f} s; the stamps "
            "from there on are moved so that time goes on"
        )
    scans: list[tuple[float, LaserLine]] = []
    odometry: list[tuple[float, list[float]]] = []
    for row in np.argsort(clock.stamps_s, kind="stable").tolist():
        stamp_s, item, place = float(clock.stamps_s[row]), log.items[row], log.place(log.numbers[row])
        what = SCANS if isinstance(item, LaserLine) else ODOMETRY
        if not clock.good[row]:
            log.left_out.add(what, "the stamp lies more than a second before its neighbours, or a day after", place)
        elif isinstance(item, LaserLine):
            if not scans or stamp_s > scans[-1][0]:
                scans.append((stamp_s, item))
            elif item.ranges_m != scans[-1][1].ranges_m:  # some logs hold a scan twice
                log.left_out.add(what, "another scan has the same stamp", place)
        elif not odometry or stamp_s > odometry[-1][0]:
            odometry.append((stamp_s, item))
        elif item != odometry[-1][1]:
            log.left_out.add(what, "another one has the same stamp", place)
    return scans, odometry
