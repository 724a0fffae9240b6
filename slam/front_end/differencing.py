"""Technique 1, difference processing: which beams fell on something that was there before.

Paper III-A-1. The printed form compares equal beams of two consecutive scans; the better one compares places, through
odometry, with scans 0.4 to 1.1 s old, and lets them vote.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray, Scan, VerdictArray
from slam.angles import sees_all_round
from slam.arithmetic.functions import cosine_sine
from slam.compiled import kernel
from slam.front_end.deskew import Beams
from slam.observations import BeamVerdict
from slam.pose import Pose2

DIFFERENCE_M = 0.1  # paper: equal beams of two scans differ by less, m; not given in print
YOUNGEST_S = 0.4  # age from which a scan is compared with, s; 0.5 s is a walker's step
OLDEST_S = 1.1  # age up to which a scan is compared with, s; odometry is good so long
VOTES = 5  # at most so many earlier scans are compared with
SUPPORT_SHARE = 0.65  # least share of the scans that looked there and found it there too
LEAST_SUPPORT = 2  # least number of scans that found it there too, where so many were compared
TOLERANCE_M = 0.12  # there means within this distance, m; a fifth of what a walker goes in 0.5 s
TOLERANCE_RAD = 0.006  # and this much more per metre of range: heading error of odometry over 1 s, rad
FEATURE_TOLERANCE_M = 0.08  # the same for features, m: twice the spread of a trunk's centre and a slip of 1 percent

CountArray = NDArray[np.int64]
NANOSECOND_S = 1e-9
WINDOW_RAD = 0.3  # very near the laser the tolerance would span the whole sweep
PROBES = 4
KEPT, NO_RETURN = int(BeamVerdict.KEPT), int(BeamVerdict.NO_RETURN)
MOVED, NOT_COMPARED = int(BeamVerdict.MOVED), int(BeamVerdict.NOT_COMPARED)


def equal_angle_difference(now: Scan, before: Scan | None, difference_m: float) -> VerdictArray:
    """Verdicts (n,) as printed: a beam is kept if the same beam of the scan before measured the same range.

    Without a comparable scan before (none, or other beams) every return is NOT_COMPARED.
    """
    verdicts = np.full(now.ranges_m.shape, BeamVerdict.NOT_COMPARED, dtype=np.uint8)
    if before is not None and np.array_equal(now.bearings_rad, before.bearings_rad):
        with np.errstate(invalid="ignore"):
            same = np.abs(now.ranges_m - before.ranges_m) <= difference_m
        verdicts[:] = np.where(same, BeamVerdict.KEPT, BeamVerdict.MOVED)
    verdicts[~np.isfinite(now.ranges_m) | (now.ranges_m <= 0.0)] = BeamVerdict.NO_RETURN
    return verdicts


class PastBeams(NamedTuple):
    """Of an earlier scan's Beams what compiled code compares with."""

    points_m: FloatArray
    ranges_m: FloatArray
    rays: FloatArray
    spacing_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """Beams of one scan, its features (k, 2) in the laser's frame, and where odometry says the laser was."""

    beams: Beams
    features_m: FloatArray
    odom_from_laser: Pose2


@dataclass(frozen=True, slots=True, eq=False)
class Vote:
    """verdicts (n,) of the beams; found_again (k,) number of voters with the same feature, of `voters`;
    looked (n,) number of voters whose view of a beam's end was free."""

    verdicts: VerdictArray
    found_again: CountArray
    looked: CountArray
    voters: int

    def licences(self, extents: CountArray) -> BoolArray:
        """(k,) True where the feature, and half of the returns from its first to its last beam (k, 2), were found
        again by enough voters."""
        licensed = np.empty(len(extents), dtype=np.bool_)
        least = min(LEAST_SUPPORT, self.voters)
        _license(self.verdicts, self.found_again, self.looked, extents, least, SUPPORT_SHARE, licensed)
        return licensed


class CompensatedVote:
    """Remembers the scans of about the last second and lets those that are old enough vote on a new one."""

    def __init__(self) -> None:
        self._past: deque[PlacedScan] = deque()

    def ask(self, placed: PlacedScan) -> Vote:
        """What the earlier scans say to this one, which is remembered for later ones.

        A place counts as found again by a scan that has a return within the tolerance of it; a scan that looked
        through it counts against it; a scan whose view of it was blocked has no vote.
        """
        beams = placed.beams
        voters = self._voters(beams.stamp_ns)
        found = np.zeros(len(beams), dtype=np.int64)
        looked = np.zeros(len(beams), dtype=np.int64)
        found_again = np.zeros(placed.features_m.shape[0], dtype=np.int64)
        for past in voters:
            past_from_now = past.odom_from_laser.inverse() @ placed.odom_from_laser
            _look_back(
                beams.points_m,
                PastBeams(past.beams.points_m, past.beams.ranges_m, past.beams.rays, past.beams.spacing_rad),
                past_from_now.as_array(),
                found,
                looked,
            )
            _find_again(
                past_from_now.transform(placed.features_m),
                past.features_m,
                FEATURE_TOLERANCE_M,
                TOLERANCE_RAD + 0.5 * past.beams.spacing_rad,
                found_again,
            )
        least = min(LEAST_SUPPORT, len(voters))
        verdicts = np.empty(len(beams), dtype=np.uint8)
        _judge(beams.ranges_m, found, looked, max(least, 1), SUPPORT_SHARE, verdicts)
        self._remember(placed)
        return Vote(verdicts, found_again, looked, len(voters))

    def _voters(self, stamp_ns: int) -> list[PlacedScan]:
        low, high = YOUNGEST_S / NANOSECOND_S, OLDEST_S / NANOSECOND_S
        ages = [(stamp_ns - past.beams.stamp_ns, past) for past in self._past if len(past.beams)]
        old_enough = [past for age, past in ages if low <= age <= high]
        if len(old_enough) <= VOTES:
            return old_enough
        step = len(old_enough) / VOTES
        return [old_enough[int((number + 0.5) * step)] for number in range(VOTES)]

    def _remember(self, placed: PlacedScan) -> None:
        stamp_ns = placed.beams.stamp_ns
        if self._past and stamp_ns <= self._past[-1].beams.stamp_ns:
            if stamp_ns == self._past[-1].beams.stamp_ns:
                return
            self._past.clear()  # time ran backwards: what was remembered belongs to another run
        oldest_ns = OLDEST_S / NANOSECOND_S
        while self._past and stamp_ns - self._past[0].beams.stamp_ns > oldest_ns:
            self._past.popleft()
        self._past.append(placed)


@kernel
def _judge(
    ranges_m: FloatArray, found: CountArray, looked: CountArray, least: int, share: float, verdicts: VerdictArray
) -> None:
    for beam in range(ranges_m.shape[0]):
        if math.isnan(ranges_m[beam]):
            verdicts[beam] = NO_RETURN
        elif looked[beam] < least:
            verdicts[beam] = NOT_COMPARED
        elif found[beam] >= least and found[beam] >= share * looked[beam]:
            verdicts[beam] = KEPT
        else:
            verdicts[beam] = MOVED


@kernel
def _license(
    verdicts: VerdictArray,
    found_again: CountArray,
    looked: CountArray,
    extents: CountArray,
    least: int,
    share: float,
    licensed: BoolArray,
) -> None:
    for feature in range(extents.shape[0]):
        first, last = extents[feature, 0], extents[feature, 1]
        kept, returned = 0, 0
        for beam in range(first, last + 1):
            kept += verdicts[beam] == KEPT
            returned += verdicts[beam] != NO_RETURN
        enough = max(float(least), share * max(looked[first], looked[last]))
        licensed[feature] = kept > 0 and 2 * kept >= returned and found_again[feature] >= enough


@kernel
def _beam_toward(rays: FloatArray, x: float, y: float) -> int:
    best, at = -np.inf, 0
    for beam in range(rays.shape[0]):
        along = rays[beam, 0] * x + rays[beam, 1] * y
        if along > best:
            best, at = along, beam
    return at


@kernel
def _look_back(
    points_m: FloatArray, past: PastBeams, past_from_now: FloatArray, found: CountArray, looked: CountArray
) -> None:
    """Count for every point (n, 2) whether one past scan looked at its place and whether it found it."""
    past_points_m, past_ranges_m, past_rays, spacing_rad = past
    tolerance_rad = TOLERANCE_RAD + 0.5 * spacing_rad
    cosine, sine = cosine_sine(past_from_now[2])
    size = past_ranges_m.shape[0]
    is_ring = sees_all_round(spacing_rad, size)
    half_beam = 0.5 * spacing_rad
    nearest = -1
    for beam in range(points_m.shape[0]):
        x_now, y_now = points_m[beam, 0], points_m[beam, 1]
        if math.isnan(x_now):
            continue
        x = past_from_now[0] + cosine * x_now - sine * y_now
        y = past_from_now[1] + sine * x_now + cosine * y_now
        distance = math.sqrt(x * x + y * y)
        if nearest < 0:
            nearest = _beam_toward(past_rays, x, y)
        # From the beam nearest to the point before, turn until the next beam is not nearer: no arc tangent.
        off = distance * half_beam
        aside = past_rays[nearest, 0] * y - past_rays[nearest, 1] * x
        turned = 0
        while aside > off and turned < size and (is_ring or nearest < size - 1):
            nearest, turned = (nearest + 1) % size, turned + 1
            aside = past_rays[nearest, 0] * y - past_rays[nearest, 1] * x
        while aside < -off and turned > -size and (is_ring or nearest > 0):
            nearest, turned = (nearest - 1) % size, turned - 1
            aside = past_rays[nearest, 0] * y - past_rays[nearest, 1] * x
        if aside > 2.0 * off or aside < -2.0 * off:
            continue
        tolerance = TOLERANCE_M + tolerance_rad * distance
        reach = 1 + int(min(tolerance / max(distance, 1e-3), WINDOW_RAD) / spacing_rad)
        stride = max(1, reach // PROBES)  # close by, beams are far denser than the tolerance
        here = False
        for step in range(2 * (reach // stride) + 1):
            other = nearest + stride * ((step + 1) // 2) if step % 2 else nearest - stride * (step // 2)
            if is_ring:
                other %= size
            if 0 <= other < size:
                gap_x, gap_y = past_points_m[other, 0] - x, past_points_m[other, 1] - y
                if gap_x * gap_x + gap_y * gap_y < tolerance * tolerance:
                    here = True
                    break
        if here:
            found[beam] += 1
            looked[beam] += 1
        elif not past_ranges_m[nearest] <= distance:
            looked[beam] += 1


@kernel
def _find_again(
    features_m: FloatArray,
    past_features_m: FloatArray,
    tolerance_m: float,
    tolerance_rad: float,
    found_again: CountArray,
) -> None:
    """Count for every feature (k, 2) whether a past scan has one (l, 2) at its place."""
    for feature in range(features_m.shape[0]):
        x, y = features_m[feature, 0], features_m[feature, 1]
        tolerance = tolerance_m + tolerance_rad * math.sqrt(x * x + y * y)
        for other in range(past_features_m.shape[0]):
            gap_x, gap_y = past_features_m[other, 0] - x, past_features_m[other, 1] - y
            if gap_x * gap_x + gap_y * gap_y < tolerance * tolerance:
                found_again[feature] += 1
                break
