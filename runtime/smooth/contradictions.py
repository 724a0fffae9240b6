"""Where the smoothed path contradicts the filter: wrong matches, landmarks that are one, and times when both part."""

import numpy as np
from scipy.spatial import cKDTree

from drivers.measurements import BoolArray, FloatArray, IntArray
from runtime.evaluate.smoothed import MOST_LISTED, Doubled, Parting, WrongMatch
from runtime.smooth.graph import Covariances
from runtime.smooth.sightings import DriveTold
from runtime.smooth.solve import SmoothedDrive, visits

LEAST_SQUARE = 60.0  # of all refuted sightings of a visit: three of them, or one gross one
LEAST_OFF_M = 0.2  # nearer to a landmark there is nothing else that it could have been
SAME_SQUARE = 9.21  # chi square of two numbers, 99 %
FARTHEST_M = 3.0  # between two landmarks that may be one: things that stand alone are not wider
PARTED_SQUARE = 11.83  # chi square of two numbers, 99.7 %: three sigma
PARTED_S, JOINED_S = 1.0, 2.0  # shorter partings are passed over, those nearer to each other are one


def wrong_matches(told: DriveTold, drive: SmoothedDrive) -> list[WrongMatch]:
    """Visits to a landmark in which the filter saw something else, the gravest first."""
    numbers, times_s = visits(told, drive.used), told.stamps_s[drive.used.scans] - told.ticks[0, 0]
    found = []
    for number in np.unique(numbers[drive.refuted]).tolist():
        rows = np.flatnonzero((numbers == number) & drive.refuted)
        square = float(drive.squares[rows].sum())
        gaps, ranges = drive.gaps[rows], drive.used.ranges_m[rows]
        off_m = float(np.hypot(gaps[:, 0], ranges * gaps[:, 1]).max())
        if square < LEAST_SQUARE or off_m < LEAST_OFF_M:
            continue
        found.append(
            WrongMatch(
                landmark=int(drive.used.identities[rows[0]]),
                start_s=round(float(times_s[rows].min()), 3),
                end_s=round(float(times_s[rows].max()), 3),
                sightings=len(rows),
                off_m=round(off_m, 3),
                square=round(square, 1),
            )
        )
    return sorted(found, key=lambda match: -match.square)[:MOST_LISTED]


def doubled(told: DriveTold, drive: SmoothedDrive, covariances: Covariances) -> list[Doubled]:
    """Pairs of landmarks of the last map that stand in one place and were never seen from one scan, nearest first."""
    solution, used = drive.solution, drive.used
    last = np.flatnonzero(np.isin(solution.identities, told.final))
    near = cKDTree(solution.landmarks[last]).query_pairs(FARTHEST_M) if len(last) else set()
    pairs = sorted((int(last[first]), int(last[second])) for first, second in near)
    index = np.searchsorted(solution.identities, used.identities)
    scans = [set(used.scans[index == number].tolist()) for number in range(len(solution.identities))]
    found = []
    for first, second in pairs:
        if scans[first] & scans[second]:
            continue
        off = solution.landmarks[first] - solution.landmarks[second]
        if off @ np.linalg.solve(covariances.between(first, second), off) < SAME_SQUARE:
            place = 0.5 * (solution.landmarks[first] + solution.landmarks[second])
            found.append(
                Doubled(
                    first=int(solution.identities[first]),
                    second=int(solution.identities[second]),
                    apart_m=round(float(np.hypot(*off)), 3),
                    x_m=round(float(place[0]), 3),
                    y_m=round(float(place[1]), 3),
                )
            )
    return sorted(found, key=lambda pair: pair.apart_m)[:MOST_LISTED]


def partings(told: DriveTold, poses: FloatArray, sampled: IntArray, spreads: FloatArray) -> list[Parting]:
    """Times in which the filter, while it was not lost, is farther from the path (n, 3) than both allow.

    spreads (k, 3, 3): covariances of the path at the sampled (k,) scans.
    """
    numbers = np.arange(len(poses))
    smoothed = np.stack(
        [np.interp(numbers, sampled, spreads[:, row, column]) for row, column in ((0, 0), (0, 1), (1, 0), (1, 1))], -1
    ).reshape(-1, 2, 2)
    off = told.filtered[:, :2] - poses[:, :2]
    both = told.covariances[:, :2, :2] + smoothed
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(both, off[:, :, None])[:, :, 0])
    times_s = told.stamps_s - told.ticks[0, 0]
    found = []
    for rows in _stretches(times_s, (squares > PARTED_SQUARE) & told.known):
        if times_s[rows[-1]] - times_s[rows[0]] >= PARTED_S:
            found.append(
                Parting(
                    start_s=round(float(times_s[rows[0]]), 3),
                    end_s=round(float(times_s[rows[-1]]), 3),
                    apart_m=round(float(np.hypot(*off[rows].T).max()), 3),
                    sigmas=round(float(np.sqrt(squares[rows].max())), 1),
                )
            )
    return sorted(found, key=lambda parting: -parting.sigmas)[:MOST_LISTED]


def _stretches(times_s: FloatArray, holds: BoolArray) -> list[IntArray]:
    """Numbers of the rows where something holds, one array for each stretch."""
    rows = np.flatnonzero(holds)
    if len(rows) == 0:
        return []
    return np.split(rows, np.flatnonzero(np.diff(times_s[rows]) > JOINED_S) + 1)
