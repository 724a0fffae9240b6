"""CARMEN logs of a circle driven in a room of 12 x 8 m, with a SICK."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from runtime.importers.data_set import import_data_set
from slam.pose import Pose2

Moment = tuple[float, float, float, float]  # s, x m, y m, heading rad
SPEED_MPS, YAW_RATE_RADPS = 0.5, 0.25


def moments(count: int = 300) -> Iterator[Moment]:
    """Times and poses, ten a second."""
    radius_m = SPEED_MPS / YAW_RATE_RADPS
    for k in range(count):
        turned = YAW_RATE_RADPS * 0.1 * k
        yield 0.1 * k, radius_m * math.sin(turned), radius_m * (1.0 - math.cos(turned)) - 2.0, turned


def room_ranges(moment: Moment, beams: int = 181, start: float = -0.5 * math.pi, step: float = 0.0) -> list[float]:
    """Distances to the walls. step: rad, 180 deg in all where nothing is said."""
    step = step or math.pi / (beams - 1)
    _, x, y, heading = moment
    found = []
    for k in range(beams):
        cosine, sine = math.cos(heading + start + step * k), math.sin(heading + start + step * k)
        away = [((6.0 if cosine > 0 else -6.0) - x) / cosine] if abs(cosine) > 1e-9 else []
        away += [((4.0 if sine > 0 else -4.0) - y) / sine] if abs(sine) > 1e-9 else []
        found.append(min(value for value in away if value > 0))
    return found


def odom(moment: Moment, start_s: float = 1e9) -> str:
    """An ODOM line."""
    t, x, y, heading = moment
    return f"ODOM {x:.6f} {y:.6f} {heading:.6f} 0.5 0.25 0 {start_s + t:.6f} host {start_s + t:.6f}"


def flaser(moment: Moment, ranges: list[float] | None = None, start_s: float = 1e9, ahead_m: float = 0.0) -> str:
    """A FLASER line. ahead_m: how far the laser sits ahead of the robot's middle."""
    t, x, y, heading = moment
    ranges = room_ranges(moment) if ranges is None else ranges
    laser = (x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading), heading)
    poses = " ".join(f"{value:.6f}" for value in (*laser, x, y, heading))
    readings = " ".join(f"{value:.2f}" for value in ranges)
    return f"FLASER {len(ranges)} {readings} {poses} {start_s + t:.6f} host {start_s + t:.6f}"


def robotlaser(moment: Moment, start: float, step: float, ranges: list[float]) -> str:
    """A ROBOTLASER1 line."""
    t, x, y, heading = moment
    readings = " ".join(f"{value:.2f}" for value in ranges)
    poses = " ".join(f"{value:.6f}" for value in (x, y, heading) * 2)
    head = f"ROBOTLASER1 0 {start:.6f} 3.141593 {step:.6f} 81.9 0.01 0 {len(ranges)}"
    return f"{head} {readings} 0 {poses} 0.5 0.25 0.3 0.3 1000 {1e9 + t:.6f} host {1e9 + t:.6f}"


def room_log(count: int = 300) -> list[str]:
    """ODOM and FLASER in turn."""
    return [line for moment in moments(count) for line in (odom(moment), flaser(moment))]


def gmapping_log(count: int) -> tuple[list[str], list[Pose2]]:
    """What GMapping makes of a straight drive of 0.1 m a line, with what the wheels told: each scan is moved 0.02 m to
    the left.
    """
    lines, wheels, told = [], [], Pose2()
    for k in range(count):
        told = told @ Pose2(0.1)
        wheels.append(Pose2(0.1 * (k + 1)))
        lines.append(f"ODOM {told.x_m} {told.y_m} 0 0 0 0 {0.2 * k:g} pippo {0.2 * k:g}")
        told = told @ Pose2(0.0, 0.02)
        scan = " ".join(f"{value:g}" for value in room_ranges((0.0, 0.1 * k - 3.0, 0.0, 0.0)))
        pose = f"{told.x_m} {told.y_m} 0"
        lines += [
            f"FLASER 181 {scan} {pose} {pose} {0.2 * k:g} pippo {0.2 * k:g}",
            f"ODOM {pose} 0 0 0 0 pippo 0",
            "NEFF 9",
        ]
    return lines, wheels


def written(path: Path, lines: list[str]) -> Path:
    """A log of these lines."""
    path.write_text("\n".join(lines) + "\n")
    return path


def imported(tmp_path: Path, lines: list[str], name: str = "a.log") -> dict[str, Any]:
    """What `infant import` says of a log of these lines."""
    return import_data_set(written(tmp_path / name, lines), tmp_path / "run")
