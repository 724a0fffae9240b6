"""Smooths a drive: finds how exact sightings and odometry really were, and leaves out the sightings that it refutes.

The noise of a configuration is made for a filter, which has to forgive; with it a robust kernel sees no wrong match. So
the noise is found from what is left over: solve, measure, solve again.
"""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from runtime.errors import UsageError
from runtime.smooth.graph import FLOORS, Noise, Solution, corrected, gaps_of, solve
from runtime.smooth.sightings import DriveTold, Sightings
from slam.pose import composed, inverted, rotated, wrap_rads

LEAST_SIGHTINGS = 3  # of a landmark
ROUNDS = 3  # of finding the noise
VISIT_GAP_S = 3.0  # sightings of a landmark farther apart are two visits
WINDOW = 20  # scans over which motions are compared with the path: what errs for long shows in no single one
LEAST_SCALE, LARGEST_SCALE = 0.05, 4.0  # of the configured noise
REFUTED_SQUARE = 18.42  # chi square of two numbers: 99.99 %
MAD = 1.4826  # median absolute deviation of a Gaussian times this is its sigma
PRIOR_CONSTANTS = (0.05, 0.05, 0.01)  # sigma of a share, a share, rad/m


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedDrive:
    """used: the sightings of landmarks that were seen often enough; refuted (m,): those of them that do not belong to
    the landmark that the filter gave them. gaps (m, 2): of all of them from the solution, range m and bearing rad;
    squares (m,): the same in the noise that was found.
    """

    solution: Solution
    noise: Noise
    used: Sightings
    refuted: BoolArray
    gaps: FloatArray
    squares: FloatArray


def smooth_drive(told: DriveTold) -> SmoothedDrive:
    """Solve until the noise is known, leave out what is refuted, and solve once more. Raises UsageError."""
    used = often_seen(told.sightings)
    if len(used.scans) == 0:
        raise UsageError(
            f"no landmark was seen {LEAST_SIGHTINGS} times in this run, so there is nothing to smooth its path by"
        )
    known = np.flatnonzero(told.known)
    anchor = int(known[0]) if len(known) else 0
    noise, start = Noise(), told.start
    for _ in range(ROUNDS):
        solution = solve(told, used, noise, start, anchor)
        noise, start = found_noise(told, used, solution, noise), solution.poses
    refuted = squared(used, solution.gaps, noise) > REFUTED_SQUARE
    solution = solve(told, used.chosen(~refuted), noise, start, anchor)
    index = np.searchsorted(solution.identities, used.identities)
    stays = np.isin(used.identities, solution.identities)  # a landmark may have lost all its sightings
    used, refuted, index = used.chosen(stays), refuted[stays], index[stays]
    gaps = gaps_of(composed(solution.poses, told.body_from_laser), solution.landmarks, used, index)
    return SmoothedDrive(solution, noise, used, refuted, gaps, squared(used, gaps, noise))


def often_seen(sightings: Sightings) -> Sightings:
    """Those of landmarks with LEAST_SIGHTINGS; the others tell nothing of the path."""
    _, index, counts = np.unique(sightings.identities, return_inverse=True, return_counts=True)
    return sightings.chosen(counts[index] >= LEAST_SIGHTINGS)


def squared(sightings: Sightings, gaps: FloatArray, noise: Noise) -> FloatArray:
    """(m,) squared Mahalanobis distances of gaps (m, 2) in range and bearing."""
    rr, bb = sightings.rr * noise.ranges**2, sightings.bb * noise.bearings**2
    rb = sightings.rb * noise.ranges * noise.bearings
    ranges, bearings = gaps.T
    square: FloatArray = (bb * ranges**2 - 2.0 * rb * ranges * bearings + rr * bearings**2) / (rr * bb - rb**2)
    return square


def visits(told: DriveTold, sightings: Sightings) -> IntArray:
    """(m,) number of the visit to its landmark that each sighting belongs to: those without a gap in between."""
    order = np.lexsort((sightings.scans, sightings.identities))
    times_s, identities = told.stamps_s[sightings.scans[order]], sightings.identities[order]
    begins = (np.diff(identities) != 0) | (np.diff(times_s) > VISIT_GAP_S)
    numbers = np.empty(len(order), dtype=np.int64)
    numbers[order] = np.concatenate(((0,), np.cumsum(begins)))
    return numbers


def found_noise(told: DriveTold, sightings: Sightings, solution: Solution, before: Noise) -> Noise:
    """From what a solution leaves over, taken together over visits and windows: what persists does not average out."""
    whitened = solution.gaps / np.sqrt(np.column_stack((sightings.rr, sightings.bb)))
    numbers = visits(told, sightings)
    counts = np.bincount(numbers)
    sums = np.column_stack([np.bincount(numbers, whitened[:, column]) for column in (0, 1)])
    scales = MAD * np.median(np.abs(sums) / np.sqrt(counts)[:, None], axis=0)
    ranges, bearings = np.clip(scales, LEAST_SCALE, LARGEST_SCALE).tolist()
    motions = min(max(_motion_scale(told, solution.poses, before), 1.0), LARGEST_SCALE)
    return Noise(ranges, bearings, motions, found_constants(told, solution.poses))


def _motion_scale(told: DriveTold, poses: FloatArray, noise: Noise) -> float:
    """How many of their standard deviations the motions of a window are off by, in the worst of three directions.

    That is a lower bound, because the path follows the motions where nothing else holds it.
    """
    motions, spreads = corrected(told.motions, noise.constants), told.motion_covariances + np.diag(FLOORS)
    whitened = []
    for first in range(0, len(poses) - WINDOW, WINDOW // 2):
        moved, covariance = np.zeros(3), np.zeros((3, 3))
        for number in range(first + 1, first + WINDOW + 1):
            step = rotated(motions[number, :2], float(moved[2]))
            along, turn = np.eye(3), np.eye(3)
            along[:2, 2] = -step[1], step[0]
            turn[:2, :2] = rotated(np.eye(2), float(moved[2])).T
            covariance = along @ covariance @ along.T + turn @ spreads[number] @ turn.T
            moved = moved + np.array((*step, motions[number, 2]))
        off = composed(inverted(poses[first]), poses[first + WINDOW]) - moved
        off[2] = wrap_rads(off[2])
        whitened.append(np.abs(off) / np.sqrt(np.diag(covariance)))
    return MAD * float(np.median(whitened, axis=0).max()) if whitened else 1.0


def found_constants(told: DriveTold, poses: FloatArray) -> tuple[float, float, float]:
    """What the odometry is off by always, by least squares over all motions of a path (n, 3)."""
    moved = composed(inverted(poses[:-1]), poses[1:])
    motions, spreads = told.motions[1:], told.motion_covariances[1:]
    distances = np.hypot(motions[:, 0], motions[:, 1])
    share, turn, sway = PRIOR_CONSTANTS
    weights = 1.0 / (np.maximum(spreads[:, 0, 0], 1e-6))
    stretch = (weights * distances * (np.hypot(moved[:, 0], moved[:, 1]) - distances)).sum()
    stretch /= (weights * distances**2).sum() + 1.0 / share**2
    weights = 1.0 / (np.maximum(spreads[:, 2, 2], 1e-8))
    regressors = np.column_stack((motions[:, 2], distances))
    normal = (regressors * weights[:, None]).T @ regressors + np.diag((1.0 / turn**2, 1.0 / sway**2))
    more = wrap_rads(moved[:, 2] - motions[:, 2])
    turned, swayed = np.linalg.solve(normal, (regressors * weights[:, None]).T @ more).tolist()
    return float(stretch), turned, swayed
