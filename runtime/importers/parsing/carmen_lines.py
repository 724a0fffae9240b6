"""One line of a CARMEN log to its numbers: ODOM, the lasers' lines and the PARAMs that say where the laser looks.

ODOM x y theta tv rv accel time host logger_time; FLASER (RLASER) n ranges x y theta odom_x odom_y odom_theta time host
logger_time; ROBOTLASER1 type start fov resolution range_max accuracy mode n ranges m remissions, laser pose, robot
pose, tv rv and three safety numbers, time host logger_time; RAWLASER1 the same without poses and what follows them;
PARAM name value time host logger_time.
"""

import math
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from runtime.errors import DataSetError
from runtime.importers.parsing.beams import MOST_BEAMS

HALF_TURN_RAD = math.pi
TURN_RAD = 2.0 * math.pi
NARROW_SICK = (101, 201, 401)  # numbers of beams that a SICK sends over 100 deg
WIDE_SICK = 361  # with more than these over 180 deg it is another laser, and only a PARAM can say how far it sees
AGREES = 0.02  # a resolution and a field of view belong together when they agree so well
COARSE_RAD = 0.1  # a resolution of more than this is one in degrees
FOV, RESOLUTION = "laser_front_laser_fov", "laser_front_laser_resolution"
MOUNT = {
    "robot_frontlaser_offset": "laser_x",
    "robot_frontlaser_side_offset": "laser_y",
    "robot_frontlaser_angular_offset": "laser_yaw",
}


@dataclass(frozen=True, slots=True)
class LaserLine:
    """One scan. start_rad, step_rad: None where the line does not say (FLASER). Poses: x m, y m, heading rad; empty
    where the line has none (RAWLASER1).
    """

    ranges_m: "array[float]"
    laser_pose: list[float]
    robot_pose: list[float]
    start_rad: float | None = None
    step_rad: float | None = None
    range_max_m: float | None = None


def stamps_s(words: list[str]) -> tuple[float, float]:
    """(when it was logged, when it was sent) of any line; the same twice in logs that have one time. Raises ValueError
    with the reason.
    """
    (logged_s,) = _numbers(words[-1:])
    return logged_s, float(words[-3]) if len(words) > 8 and _is_number(words[-3]) else logged_s


def odometry_line(words: list[str]) -> list[float]:
    """Pose of an ODOM line. Raises ValueError with the reason."""
    if len(words) < 5:
        raise ValueError("the line ends early")
    return _numbers(words[1:4])


def laser_line(words: list[str]) -> LaserLine:
    """The line of any laser. Raises ValueError with the reason."""
    if words[0].startswith(("ROBOTLASER", "RAWLASER")):
        return _robot_laser_line(words)
    beams, rest = _beams(words, 1, 7)
    poses = _numbers(rest[:6])
    return LaserLine(array("f", map(float, words[2 : 2 + beams])), poses[:3], poses[3:])


def _robot_laser_line(words: list[str]) -> LaserLine:
    """A ROBOTLASER or RAWLASER line, which say where their beams look. Raises ValueError with the reason."""
    is_raw = words[0].startswith("RAWLASER")
    beams, rest = _beams(words, 8, 4 if is_raw else 7)
    start_rad, step_rad, range_max_m = _numbers([words[2], words[4], words[5]])
    if step_rad == 0.0 and beams > 1:
        raise ValueError("its angular resolution is 0")
    remissions = int(rest[0])
    if remissions < 0 or len(rest) < 1 + remissions + (3 if is_raw else 7):
        raise ValueError("the line ends early")
    poses = [] if is_raw else _numbers(rest[1 + remissions : 7 + remissions])
    ranges_m = array("f", map(float, words[9 : 9 + beams]))
    return LaserLine(ranges_m, poses[:3], poses[3:], start_rad, step_rad, range_max_m)


def angles(line: LaserLine, told: Mapping[str, float]) -> tuple[float, float]:
    """(bearing of the first beam, step) rad: what the line says, else what the log's PARAMs say, else those of a SICK.

    180 beams end one step short of +90 deg, 181 at it.
    """
    beams = len(line.ranges_m)
    if line.start_rad is not None and line.step_rad is not None:
        return line.start_rad, line.step_rad
    if beams == 1:
        return 0.0, 0.0
    usual_rad = math.radians(100.0) if beams in NARROW_SICK else HALF_TURN_RAD
    spans = beams if beams % 2 == 0 else beams - 1
    said = told.get(RESOLUTION)
    step_rad = None if said is None else _radians(said, COARSE_RAD)
    fov_rad = _radians(told[FOV], TURN_RAD) if FOV in told else None
    if fov_rad is None:
        fov_rad = usual_rad if step_rad is None else step_rad * spans
    fitting = [n for n in (spans, beams - 1, beams) if step_rad and abs(step_rad * n / fov_rad - 1.0) < AGREES]
    return -0.5 * fov_rad, fov_rad / (fitting[0] if fitting else spans)


def is_guessed(line: LaserLine, told: Mapping[str, float]) -> bool:
    """Whether nobody says over which angle so many beams are spread."""
    beams = len(line.ranges_m)
    return line.start_rad is None and beams > WIDE_SICK and beams not in NARROW_SICK and not {FOV, RESOLUTION} & {*told}


def parameter(words: list[str], told: dict[str, float]) -> None:
    """Keep a PARAM that says how the laser is mounted or how it looks. Raises ValueError with the reason."""
    if len(words) > 2 and words[1] in (FOV, RESOLUTION, *MOUNT):
        (told[words[1]],) = _numbers(words[2:3])
        if words[1] in (FOV, RESOLUTION) and told[words[1]] <= 0.0:
            del told[words[1]]
            raise ValueError(f"{words[1]} = {words[2]}, expected a positive angle")


def mount_of(told: Mapping[str, float], source: object) -> dict[str, Any]:
    """The laser's place as a data set's `vehicle` gives it. Raises DataSetError for one that no vehicle has."""
    found = {name: told[key] for key, name in MOUNT.items() if told.get(key)}
    if any(abs(value) > 20.0 for value in found.values()):
        raise DataSetError(f"{source}: its PARAM lines put the laser at {found}; expected metres and radians")
    return found


def _beams(words: list[str], place: int, least: int) -> tuple[int, list[str]]:
    """Number of beams, and the words behind them. Raises ValueError where there are none, or fewer words than least."""
    beams = int(words[place])
    if not 1 <= beams <= MOST_BEAMS:
        raise ValueError(f"it has {beams} beams")
    rest = words[place + 1 + beams :]
    if len(rest) < least:
        raise ValueError("the line ends early")
    return beams, rest


def _numbers(words: list[str]) -> list[float]:
    """Finite numbers. Raises ValueError with the word that is none."""
    numbers = [float(word) for word in words]
    for word, number in zip(words, numbers, strict=True):
        if not math.isfinite(number):
            raise ValueError(f"{word} is not a number")
    return numbers


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _radians(value: float, largest_rad: float) -> float:
    """An angle that some write in degrees."""
    return math.radians(value) if value > largest_rad * (1.0 + AGREES) else value
