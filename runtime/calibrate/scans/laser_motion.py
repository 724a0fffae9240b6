"""The laser's own account of a drive: its motion from one keyframe to the next."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.calibrate.dead_reckoning import DeadReckoning, seen_by_laser
from runtime.calibrate.drive_data import DriveData, WheelSeries
from runtime.calibrate.scans.match import Match, match
from runtime.calibrate.scans.shapes import Shapes, shapes
from runtime.calibrate.wheel_model import WheelModel
from slam.pose import composed, inverted, rotated

# far enough that matching noise (some mm) is small beside the slip, near enough that both scans show the same
KEYFRAME_M, KEYFRAME_RAD = 0.5, 0.6
LONGEST_S = 5.0
STILL = 0.01  # m, rad, m/s, rad/s: less is no motion
SPEED_WINDOW_S = 0.2
FEWEST_PAIRS = 4
MOST_OUTLIERS = 0.5
MOST_STEPS = 100_000
# mean velocity over so long to either side undoes the motion within a sweep: a shorter window lets slip into the
# laser's account as well, where it passes for latency
VELOCITY_WINDOW_S = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class LaserMotion:
    """Steps of one drive: begin and end times_s (n, 2), motion of the laser as means (n, 3) and covariances.

    series: the wheels' samples; failed: pairs of keyframes that showed too little in common.
    """

    series: WheelSeries
    times_s: FloatArray
    means: FloatArray
    covariances: FloatArray
    failed: int


def laser_motion(drive: DriveData, model: WheelModel, parameters: FloatArray, most: int = MOST_STEPS) -> LaserMotion:
    """Choose keyframes by the wheels, undo the motion within each sweep, and match each with the one before.

    most: pairs of keyframes, taken evenly from the drive.
    """
    series = drive.wheel_series()
    stamps = drive.scan_times_s()
    mount, latency = parameters[-4:-1], float(parameters[-1])
    wheels = model.dead_reckoning(series, parameters)
    true_s = stamps - latency
    known = (true_s > series.times_s[0]) & (true_s < series.times_s[-1])
    seen: dict[int, Shapes] = {}

    def shapes_of(number: int) -> Shapes:
        if number not in seen:
            scan = drive.scans[number]
            middle_s = true_s[number] + (0.5 * len(scan.ranges_m) - scan.stamp_beam) * scan.beam_period_s
            seen[number] = shapes(scan, laser_twist(wheels, float(middle_s), mount))
        return seen[number]

    steps: list[tuple[int, int, Match]] = []
    failed = 0
    # the same keyframes in every pass: a step more or less would move the result by a part of its interval
    start = model.start
    chosen = keyframes(model.dead_reckoning(series, start), stamps - start[-1], known)
    pairs = list(pairwise(chosen))
    pairs = pairs[:: max(1, len(pairs) // most)][::-1]
    while pairs:
        there, here = pairs.pop()
        if _silence(series, true_s[there], true_s[here]):
            continue
        result = match(shapes_of(there), shapes_of(here), _guess(wheels, true_s[[there, here]], mount))
        if result.pairs >= FEWEST_PAIRS and result.outlier_share <= MOST_OUTLIERS:
            steps.append((there, here, result))
        elif here - there > 1 and len(pairs) + len(steps) < MOST_STEPS:
            # too far apart to see the same: two shorter steps
            middle = (there + here) // 2
            pairs += [(middle, here), (there, middle)]
        else:
            failed += 1
    return LaserMotion(
        series,
        stamps[np.array([(there, here) for there, here, _ in steps], dtype=np.int64).reshape(-1, 2)],
        np.array([result.mean for _, _, result in steps]).reshape(-1, 3),
        np.array([_floored(result) for _, _, result in steps]).reshape(-1, 3, 3),
        failed,
    )


def keyframes(wheels: DeadReckoning, times_s: FloatArray, known: NDArray[np.bool_]) -> list[int]:
    """Numbers of the scans that are matched: a fixed time apart while the rover moves.

    The time is such that nine tenths of the steps stay within KEYFRAME_M and KEYFRAME_RAD. Steps chosen by the distance
    itself end where a wheel has just slipped forward, which makes its radius come out 0.1 % small in simulation.
    """
    numbers = np.flatnonzero(known)
    if len(numbers) < 2:
        return []
    speed, turning = np.abs(wheels.velocity(times_s[numbers], SPEED_WINDOW_S)).T
    moving = (speed > STILL) | (turning > STILL)
    if not moving.any():
        return []
    fastest, sharpest = np.percentile(speed[moving], 90), np.percentile(turning[moving], 90)
    period = min(KEYFRAME_M / max(fastest, STILL), KEYFRAME_RAD / max(sharpest, STILL), LONGEST_S)
    period -= 0.5 * float(np.median(np.diff(times_s[numbers])))
    metres, radians = (_gone_through(wheels, values, times_s) for values in (wheels.distances_m, wheels.poses[:, 2]))
    chosen = [int(numbers[0])]
    for index in numbers[1:]:
        last = chosen[-1]
        moved = metres[index] - metres[last] > STILL or radians[index] - radians[last] > STILL
        if moved and times_s[index] - times_s[last] > period:
            chosen.append(int(index))
    return chosen


def _gone_through(wheels: DeadReckoning, values: FloatArray, times_s: FloatArray) -> FloatArray:
    """Sum of all changes of the values up to the times, whatever their sign."""
    return np.interp(times_s, wheels.times_s, np.concatenate(((0.0,), np.cumsum(np.abs(np.diff(values))))))


def laser_twist(wheels: DeadReckoning, time_s: float, mount: FloatArray) -> FloatArray:
    """Velocity (3,) of the laser in its own frame: m/s ahead and left, rad/s."""
    speed, yaw_rate = wheels.velocity(np.array([time_s]), VELOCITY_WINDOW_S)[0]
    x, y, heading = mount
    ahead, left = rotated(np.array((speed - yaw_rate * y, yaw_rate * x)), -heading)
    return np.array((ahead, left, yaw_rate))


def _guess(wheels: DeadReckoning, times_s: FloatArray, mount: FloatArray) -> FloatArray:
    poses = wheels.at(times_s)
    body = composed(inverted(poses[:1]), poses[1:])
    guess: FloatArray = seen_by_laser(body, mount)[0]
    return guess


def _silence(series: WheelSeries, begin_s: float, end_s: float) -> bool:
    """True if the wheels were silent anywhere between."""
    first, last = np.searchsorted(series.times_s, (begin_s, end_s))
    return bool(series.broken[first : last + 1].any())


def _floored(result: Match) -> FloatArray:
    """Nothing is better than a tenth of a millimetre and of a milliradian: keeps weights finite."""
    floored: FloatArray = result.covariance + 1e-8 * np.eye(3)
    return floored
