"""CARMEN logs, the text format of the Radish and Freiburg archives, as the same arrays that other sets come in.

Whatever cannot be read is left out and counted, with its line: a log that was cut off, a laser that was not connected,
a clock that was set during the drive.
"""

import itertools
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import DataSetError
from runtime.evaluate.rows import relative_poses
from runtime.importers.archive import Archive
from runtime.importers.parsing import carmen_lines
from runtime.importers.parsing.beams import padded_ranges
from runtime.importers.parsing.carmen_lines import LaserLine
from runtime.importers.parsing.clock_steps import step_sentences
from runtime.importers.parsing.gmapping_output import MARK, wheels_own_motion
from runtime.importers.parsing.left_out import LeftOut
from runtime.importers.parsing.line_times import LineTimes, line_times
from runtime.importers.parsing.text_lines import TextLines

SICK_NO_RETURN_M = 80.0  # from here on the SICK's readings are codes, not distances
SAME_M = 1e-4  # logs are written with five or six decimals
LASERS = ("ROBOTLASER1", "FLASER", "RAWLASER1", "ROBOTLASER2", "RLASER", "RAWLASER2", "LASER3", "LASER4")
"""Lines of lasers, the one that is read first where a log has several: those that say where their beams look, then
those of the laser in front."""
WORDS = ("ODOM", "PARAM", *LASERS)
SCANS, ODOMETRY = "scans", "odometry samples"
MOST_NAMED = 3
LINE_BYTES, BEAM_BYTES = 900, 12  # of memory for each line and for each of its beams, with all that is made of them


@dataclass(frozen=True, slots=True)
class _Line:
    """One line with its number, its word and its two stamps in seconds: logged, sent."""

    number: int
    word: str
    stamps_s: tuple[float, float]
    item: LaserLine | list[float]


@dataclass(slots=True)
class _Log:
    """What was gathered: scans and odometry in the order of writing, and what PARAM lines tell."""

    source: Path
    left_out: LeftOut = field(default_factory=LeftOut)
    lines: list[_Line] = field(default_factory=list)
    told: dict[str, float] = field(default_factory=dict)
    is_gmapping: bool = False

    def place(self, number: int) -> str:
        return f"{self.source.name}:{number}"


def load_carmen(source: Path) -> Archive:
    """Read a log, also compressed by gzip, to its last whole line. Raises DataSetError where it holds no scan."""
    log, lines = _Log(source), TextLines(source)
    try:
        for number, line, is_whole in lines:
            beams = _read(line, number, is_whole, log)
            lines.keep(0 if beams is None else LINE_BYTES + BEAM_BYTES * beams)
    except OSError as error:
        raise DataSetError(f"{source} cannot be read as a CARMEN log ({error}); fetch it again") from error
    if lines.damage:
        log.left_out.warnings.append(f"{source.name} is read up to its last complete line: {lines.damage}")
    _choose_laser(log)
    if log.is_gmapping:
        _undo_corrections(log)
    return _archive(log)


def _read(line: str, number: int, is_whole: bool, log: _Log) -> int | None:
    """Keep what the line says; the number of its beams, None where nothing of it is kept."""
    words = line.split()
    if not words or words[0] not in WORDS:
        log.is_gmapping |= words[:1] == [MARK]
        return None
    what = ODOMETRY if words[0] == "ODOM" else SCANS
    try:
        if words[0] == "PARAM":
            carmen_lines.parameter(words, log.told)
            return None
        item = carmen_lines.odometry_line(words) if what is ODOMETRY else carmen_lines.laser_line(words)
        word = WORDS[WORDS.index(words[0])]  # one text for all lines
        log.lines.append(_Line(number, word, carmen_lines.stamps_s(words), item))
        return len(item.ranges_m) if isinstance(item, LaserLine) else 0
    except (ValueError, IndexError) as error:
        reason = f"{words[0]} line cannot be read ({error})" if is_whole else "the log was cut off in this line"
        log.left_out.add("PARAM lines" if words[0] == "PARAM" else what, reason, log.place(number))
        return None


def _choose_laser(log: _Log) -> None:
    """Keep the lines of one laser: a run has one. The others are counted and named."""
    counts = Counter(line.word for line in log.lines if isinstance(line.item, LaserLine))
    if len(counts) < 2:
        return
    most = max(counts.values())
    chosen = next(word for word in LASERS if 2 * counts[word] > most)
    others = " and ".join(f"{counts[word]} {word}" for word in LASERS if counts[word] and word != chosen)
    log.left_out.notes.append(
        f"{counts[chosen]} {chosen} lines are read, {others} lines are not: a run has one laser (to read "
        f"another, remove the {chosen} lines)"
    )
    log.lines = [line for line in log.lines if line.word in ("ODOM", chosen)]


def _undo_corrections(log: _Log) -> None:
    """Of a log that a SLAM wrote, the motion that the wheels told."""
    items = wheels_own_motion([line.item for line in log.lines])
    is_undone = any(new is not None and new != line.item for line, new in zip(log.lines, items, strict=True))
    log.lines = [replace(line, item=item) for line, item in zip(log.lines, items, strict=True) if item is not None]
    if is_undone:
        log.left_out.notes.append(
            "GMapping wrote this log: its corrections are removed from the odometry, and kept as the reference"
        )
    else:
        log.left_out.warnings.append(
            f"GMapping wrote {log.source.name} and left no odometry between the scans: corrected poses are "
            "used in its place"
        )


def _archive(log: _Log) -> Archive:
    scans, odometry = _in_order(log)
    if not scans:
        first = "; ".join(filter(None, (log.left_out.first(), *log.left_out.warnings)))
        raise DataSetError(
            f"{log.source} holds no usable scan ({', '.join(LASERS)} lines){f'; {first}' if first else ''}; "
            "nothing was written"
        )
    lines = [line for _, line in scans]
    beams = max(len(line.ranges_m) for line in lines)
    geometry = np.array([(*carmen_lines.angles(line, log.told), len(line.ranges_m)) for line in lines])
    arrays: dict[str, Any] = {
        "scan_t": np.array([stamp_s for stamp_s, _ in scans]),
        "ranges": padded_ranges([line.ranges_m for line in lines]),
        "scan_angle_min": geometry[:, 0],
        "scan_angle_increment": geometry[:, 1],
        "scan_beams": geometry[:, 2].astype(np.int64),
    }
    if lines[0].robot_pose:
        arrays["scan_odom_pose"] = np.array([line.robot_pose for line in lines])
    if odometry:
        arrays |= {"odom_t": np.array([stamp_s for stamp_s, _ in odometry])}
        arrays |= {"odom_pose": np.array([pose for _, pose in odometry])}
    _name_odd_beams(log, Counter(len(line.ranges_m) for line in lines))
    if guessed := sum(carmen_lines.is_guessed(line, log.told) for line in lines):
        log.left_out.warnings.append(
            f"{guessed} scans of {beams} beams are taken to span 180 deg, because the log does not say; if "
            f"that is wrong, add the line 'PARAM {carmen_lines.FOV} RADIANS' at the top"
        )
    return Archive(f"carmen {log.source.name}", log.source, arrays, _meta(log, lines, arrays), log.left_out)


def _meta(log: _Log, lines: list[LaserLine], arrays: dict[str, Any]) -> dict[str, Any]:
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
    if not lines[0].robot_pose:
        return meta
    laser = np.array([line.laser_pose for line in lines])
    mount = relative_poses(arrays["scan_odom_pose"], laser)
    if np.abs(mount - mount[0]).max() > SAME_M:  # not the mount: the log was corrected by someone's SLAM
        arrays |= {"gt_t": arrays["scan_t"], "gt_xy": laser[:, :2], "gt_theta": laser[:, 2]}
        meta["gt_kind"] = "poses that the log gives for the laser: another SLAM's estimate, not independent truth"
    elif np.abs(mount[0]).max() > SAME_M:
        meta["vehicle"] = dict(zip(("laser_x", "laser_y", "laser_yaw"), mount[0].round(6).tolist(), strict=True))
    return meta


def _largest_m(ranges: np.ndarray[Any, Any]) -> float:
    return float(ranges[np.isfinite(ranges)].max(initial=0.0)) or SICK_NO_RETURN_M


def _name_odd_beams(log: _Log, counts: Counter[int]) -> None:
    """Say it where a laser did not always send as many beams: each count is spread over the angle by itself."""
    (usual, _), *odd = counts.most_common()
    if odd:
        others = ", ".join(f"{count} of {beams}" for beams, count in odd[:MOST_NAMED])
        more = f" and {len(odd) - MOST_NAMED} other numbers" if len(odd) > MOST_NAMED else ""
        log.left_out.notes.append(f"scans have {usual} beams, but {others}{more}; each is spread over the whole angle")


def _in_order(log: _Log) -> tuple[list[tuple[float, LaserLine]], list[tuple[float, list[float]]]]:
    """Scans and odometry by their time, on one clock that never goes back; each time once."""
    times = _times(log)
    scans: list[tuple[float, LaserLine]] = []
    odometry: list[tuple[float, list[float]]] = []
    for row in np.argsort(times.stamps_s, kind="stable").tolist():
        stamp_s, item, place = float(times.stamps_s[row]), log.lines[row].item, log.place(log.lines[row].number)
        what = SCANS if isinstance(item, LaserLine) else ODOMETRY
        if not times.good[row]:
            log.left_out.add(what, "the stamp is more than a second before its neighbours, or a day after", place)
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


def _times(log: _Log) -> LineTimes:
    """When each line was written, with what had to be done about it in words."""
    scans = [(k, line.item) for k, line in enumerate(log.lines) if isinstance(line.item, LaserLine)]
    is_laser, is_scan = np.zeros((2, len(log.lines)), bool)
    is_laser[[k for k, _ in scans]] = True
    is_scan[[k for k, _ in scans]] = True
    is_scan[[k for (_, before), (k, scan) in itertools.pairwise(scans) if before.ranges_m == scan.ranges_m]] = False
    columns = [np.array([line.stamps_s[k] for line in log.lines]) for k in (0, 1)]
    times = line_times(columns, is_scan, ~is_laser)
    log.left_out.warnings += step_sentences(
        times.steps, lambda row: f"{log.place(log.lines[row].number)}: the clock of the log"
    )
    if times.lost:
        log.left_out.warnings.append(f"{log.source.name}: {times.lost}")
    return times
