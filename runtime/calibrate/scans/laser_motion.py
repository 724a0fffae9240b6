"""The laser's own account of a drive: its motion from one keyframe to the next."""

from collections.abc import Sequence
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
EVERY_PAIR = 100_000
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


def laser_motion(
    drive: DriveData,
    model: WheelModel,
    parameters: FloatArray,
    most: int = EVERY_PAIR,
    seen: dict[int, Shapes] | None = None,
) -> LaserMotion:
    """Choose keyframes by the wheels, undo the motion within each sweep, and match each with the one before.

    most: pairs of keyframes, taken evenly from the drive. seen: shapes by number of the scan, of the same drive with
    the same parameters; more are added.
    """
    series = drive.wheel_series()
    stamps = drive.scan_times_s()
    mount, latency = parameters[-4:-1], float(parameters[-1])
    wheels = model.dead_reckoning(series, parameters)
    true_s = stamps - latency
    known = (true_s > series.times_s[0]) & (true_s < series.times_s[-1])
    seen = {} if seen is None else seen
    steps: dict[tuple[int, int], Match] = {}
    failed = 0
    # the same keyframes in every pass: a step more or less would move the result by a part of its interval
    start = model.start
    chosen = keyframes(model.dead_reckoning(series, start), stamps - start[-1], known)
    pairs = list(pairwise(chosen))
    pairs = pairs[:: max(1, len(pairs) // most)]
    while pairs := [pair for pair in pairs if not _silence(series, *true_s[list(pair)])]:
        _add_shapes(seen, sorted({number for pair in pairs for number in pair}), drive, wheels, true_s, mount)
        befores, afters = ([seen[pair[end]] for pair in pairs] for end in (0, 1))
        results = match(befores, afters, _guesses(wheels, true_s[np.array(pairs)], mount))
        apart: list[tuple[int, int]] = []
        for (there, here), result in zip(pairs, results, strict=True):
            if result.pairs >= FEWEST_PAIRS and result.outlier_share <= MOST_OUTLIERS:
                steps[there, here] = result
            elif here - there > 1:  # too far apart to see the same: two shorter steps
                middle = (there + here) // 2
                apart += [(there, middle), (middle, here)]
            else:
                failed += 1
        pairs = apart
    numbers, found = sorted(steps), [steps[pair] for pair in sorted(steps)]
    return LaserMotion(
        series,
        stamps[np.array(numbers, dtype=np.int64).reshape(-1, 2)],
        np.array([result.mean for result in found]).reshape(-1, 3),
        np.array([_floored(result) for result in found]).reshape(-1, 3, 3),
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


def _add_shapes(
    seen: dict[int, Shapes],
    numbers: Sequence[int],
    drive: DriveData,
    wheels: DeadReckoning,
    true_s: FloatArray,
    mount: FloatArray,
) -> None:
    """Find the shapes in those of the scans whose are not known yet."""
    new = [number for number in numbers if number not in seen]
    scans = [drive.scans[number] for number in new]
    half_s = [(0.5 * len(scan.ranges_m) - scan.stamp_beam) * scan.beam_period_s for scan in scans]
    twists = laser_twists(wheels, true_s[new] + half_s, mount)
    seen |= {number: shapes(scan, twist) for number, scan, twist in zip(new, scans, twists, strict=True)}


def laser_twists(wheels: DeadReckoning, times_s: FloatArray, mount: FloatArray) -> FloatArray:
    """Velocity (n, 3) of the laser in its own frame: m/s ahead and left, rad/s."""
    speeds, yaw_rates = wheels.velocity(times_s, VELOCITY_WINDOW_S).T
    x, y, heading = mount
    sideways = rotated(np.stack((speeds - yaw_rates * y, yaw_rates * x), axis=-1), -heading)
    return np.column_stack((sideways, yaw_rates))


def _guesses(wheels: DeadReckoning, times_s: FloatArray, mount: FloatArray) -> FloatArray:
    """Motion (n, 3) of the laser between times_s (n, 2), as the wheels say."""
    poses = wheels.at(times_s.ravel()).reshape(-1, 2, 3)
    return seen_by_laser(composed(inverted(poses[:, 0]), poses[:, 1]), mount)


def _silence(series: WheelSeries, begin_s: float, end_s: float) -> bool:
    """True if the wheels were silent anywhere between."""
    first, last = np.searchsorted(series.times_s, (begin_s, end_s))
    return bool(series.broken[first : last + 1].any())


def _floored(result: Match) -> FloatArray:
    """Nothing is better than a tenth of a millimetre and of a milliradian: keeps weights finite."""
    floored: FloatArray = result.covariance + 1e-8 * np.eye(3)
    return floored
