"""Lays a scan onto those before it where the wheels do not tell well enough how the rover moved (decisions 16, 26, 27).

The motion by the wheels is the prior of a point-to-line alignment (Censi 2008) with a few earlier scans; the
result enters the filter as the increment that the wheels would have given, better known.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from drivers.measurements import FloatArray, IntArray, Scan, ScanLike
from slam.arithmetic.functions import cosine_sine
from slam.arithmetic.small_matrices import inverse, squared_distance
from slam.front_end.alignment_kernels import EarlierScans, surface_normals
from slam.front_end.alignment_search import GATE_LAST_M, Search, same_directions
from slam.front_end.deskew import Beams, Twist, deskew, sharp_to_m
from slam.front_end.differencing import LEAST_SUPPORT, OLDEST_S
from slam.front_end.wide_search import Found, Known, View, WideSearch, unknown
from slam.odometry.odometry import Increment
from slam.odometry.slip import corrected, is_too_far
from slam.odometry.trust import WheelTrust
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings

PAST_SCANS = 5  # a scan is laid onto so many earlier ones (decision 0016)
MOST_POINTS = 200  # at most so many beams of a scan are used
WHEELS_SIGMA_M = 0.02  # m; over seconds the wheels and the laser's mount are not more exact
WHEELS_SIGMA_RAD = 0.01  # rad; the same for turns
LEAST_POINTS = 25  # with fewer points on surfaces nothing is refined
LEAST_VIEW_RAD = 1.0  # nor where what came back fills less of the view: people in an open place fill a third of that
LEAST_SHARE = 0.3  # nor with a smaller share of the points that came back
NEED_M = 0.15  # half the width of a door post: what the wheels may be off by before features are matched wrongly
NEED_AMONG_WALLS_M = 0.1  # the same where a scan shows surfaces, onto which it can be laid more exactly than that
LAID_ALONE_M, WALLS_ALONE_M = 0.1, 0.27  # above the latter, a landmark's gate of 3.7 sigma reaches the next door frame
USUALLY, WALLS_GAIN = 0.5, 0.1  # of the last ten scans have shown walls
WALLS_SHARE = 0.8  # of the returns of a scan that lie on surfaces there: trees have half of them
TORN_SHARE = 0.2  # so many points fewer, under the best motion too: 0.24 to 0.58 where a rover was carried, else 0.11
UNUSUAL_SHARE = 0.15  # so many points fewer than usual on surfaces of the scan before say that the wheels are wrong
FIRST_USUAL_SHARE, USUAL_GAIN = 0.9, 0.05
NEED_RANGE_M = 10.0  # at this distance: what a wrong heading moves
WIDEST_SQUARE = 30.0  # nor where the result contradicts the wheels by this squared distance, unless they have slipped:
SUSPECT_SQUARE = 11.3  # that wheels which were only suspected are off by, 99 % of what chance makes of three numbers
SLIPPED = np.diag(np.square((0.15, 0.15, 0.1)))  # m^2, rad^2, of the motion by wheels that are suspected
FAR_SLIPPED = 4.0 * SLIPPED
TURNED = np.diag(np.square((0.0, 0.0, 0.1)))  # of wheels of which one has slipped
TURNED_STARTS = 9  # headings, where the scan lies worse than usual at those that the wheels admit
SLIP_SHARE = 0.7  # so many points are on surfaces then
SLIP_GAIN = 0.05  # and so many more than by the wheels' motion
LATEST = 2  # scans with which a walker could be mistaken for what stands
POOR_SHARE = 0.25  # so many points fewer than usual on surfaces say that the best motion near the wheels' is wrong too
WIDE_PAUSE_NS = 1_000_000_000  # between two searches far from where the wheels say: each costs some milliseconds


@dataclass(slots=True, eq=False)
class SeenFrom:
    """A scan as it was taken, and where the body was on a path of refined increments; surfaces when first needed."""

    scan: Scan
    twist: Twist
    path_from_body: Pose2
    beams: Beams | None = None
    normals: FloatArray | None = None


class Alignment:
    """Remembers the last scans; refines an increment where the wheels alone could not tell which feature is which, and
    where too few of the scans are young enough to vote on the new one.

    refined: how many increments it has refined; found_widely: how many of them by the wide search, made last at
    searched_ns. laid: the beams of the latest scan where it was laid onto others, or is_due to be laid onto keyframes,
    for what good wheels add up to; else None. is_disputed: it contradicts the wheels, and neither is clearly right.
    is_torn: it lies on the scans before under no motion, though walls were seen: the rover is somewhere else.
    """

    def __init__(self, settings: FrontEndSettings, body_from_laser: Pose2) -> None:
        self._settings = settings
        self._body_from_laser = body_from_laser
        self._past: deque[SeenFrom] = deque(maxlen=max(1 + PAST_SCANS * (PAST_SCANS - 1) // 2, LEAST_SUPPORT))
        self._path_from_body = Pose2()
        self._trust = WheelTrust()
        self._usual_share = self._usual_fit = FIRST_USUAL_SHARE
        self.searched_ns: int | None = None
        self.refined = self.found_widely = 0
        self.laid: Beams | None = None
        self.is_disputed = self.is_due = self.is_torn = self._could_be_laid = False
        self._since_laid, self._usual_walls = np.zeros((3, 3)), 0.0
        self._known: Known = unknown

    @property
    def alone_m(self) -> float:
        """Sigma of where a landmark should be seen above which it should not move the pose alone; inf where it must."""
        if self._could_be_laid:
            return WALLS_ALONE_M
        return LAID_ALONE_M if self.laid is not None or self.is_disputed else math.inf

    def refine(self, scan: ScanLike, increment: Increment, known: Known = unknown) -> Increment:
        """The increment up to this scan, better known where that is needed, as it is elsewhere. Where the map has the
        scan known where the wheels say, it is not looked for far from there.

        Shown every scan once and in order. Raises ValueError when the bearings of a sparse scan do not increase.
        """
        self.laid, self.is_disputed, self.is_due, self._could_be_laid = None, False, False, False
        self.is_torn, self._known = False, known
        if not self._settings.alignment.enabled or not isinstance(scan, Scan) or scan.ranges_m.size < 2:
            return increment
        now = SeenFrom(scan, Twist(increment.speed_mps, increment.lateral_mps, increment.yaw_rate_radps), Pose2())
        if self._past:
            sees_walls = self._is_among_walls()
            self._usual_walls += WALLS_GAIN * (sees_walls - self._usual_walls)
            if not increment.at_rest and (self._sparse(scan.stamp_ns) or self._is_needed(increment, sees_walls)):
                increment = self._aligned(now, increment)
            elif sees_walls:
                self._could_be_laid = True
                if self._looks_unusual(now, increment):
                    increment = self._aligned(now, increment, only_if_slipped=True)
                self._since_laid += np.nan_to_num(self._trust.scaled(increment.covariance))
                is_off = _off_m(self._since_laid) > NEED_AMONG_WALLS_M and not self.is_disputed
                self.is_due = self.laid is None and is_off and len(self._returned(now)) > 0
                self.laid = self._beams(now) if self.is_due else self.laid
            else:  # nothing has to be laid, and a building is not left in one scan
                self._could_be_laid = self._usual_walls > USUALLY
            if self.laid is not None:
                self._since_laid[:] = 0.0
        self._path_from_body = now.path_from_body = self._path_from_body @ increment.as_pose()
        self._past.append(now)
        return increment

    def _sparse(self, stamp_ns: int) -> bool:
        """True where one of the last scans that a vote needs is too old for it."""
        oldest_ns = OLDEST_S * 1e9
        needed = list(self._past)[-LEAST_SUPPORT:]
        return any(stamp_ns - past.scan.stamp_ns > oldest_ns for past in needed)

    def _is_needed(self, increment: Increment, sees_walls: bool) -> bool:
        """True where the wheels could move what is matched by more than things lie apart, or than walls are seen to."""
        return _off_m(self._trust.scaled(increment.covariance)) > (NEED_AMONG_WALLS_M if sees_walls else NEED_M)

    def _looks_unusual(self, now: SeenFrom, increment: Increment) -> bool:
        """Whether the scan lies on the one before worse than it usually does by the wheels' motion."""
        search = self._search(now, [self._past[-1]])
        if search is None:
            return False
        share = search.on_surfaces(increment.mean) / len(search.points_m)
        usual = self._usual_share
        self._usual_share += USUAL_GAIN * (share - usual)
        return share < usual - UNUSUAL_SHARE

    def _is_among_walls(self) -> bool:
        """Whether the scan before saw mostly surfaces."""
        before = self._past[-1]
        returned = (~np.isnan(self._beams(before).ranges_m)).sum()
        return bool((~np.isnan(self._normals(before)[:, 0])).sum() >= WALLS_SHARE * max(returned, 1))

    def _search(self, now: SeenFrom, past: list[SeenFrom]) -> Search | None:
        """The search for the motion that lays a scan onto earlier ones; None where there is too little to see."""
        past = [seen for seen in past if same_directions(seen.scan, now.scan)]
        beams, returned = self._beams(now), self._returned(now)
        if not past or not len(returned):
            return None
        points = beams.points_m[returned[:: -(-len(returned) // MOST_POINTS)]]
        past_from_body = [
            (seen.path_from_body @ self._body_from_laser).inverse() @ self._path_from_body for seen in past
        ]
        earlier = EarlierScans(
            np.stack([self._beams(seen).points_m for seen in past]),
            np.stack([self._normals(seen) for seen in past]),
            np.array([(p.x_m, p.y_m, *cosine_sine(p.heading_rad)) for p in past_from_body]),
            float(now.scan.bearings_rad[0]),
            beams.spacing_rad,
        )
        return Search(self._body_from_laser.transform(points), earlier)

    def _aligned(self, now: SeenFrom, increment: Increment, only_if_slipped: bool = False) -> Increment:
        """The increment that lays the scan onto those before it; as it was where that cannot be told, or where the
        wheels were only suspected and are not clearly wrong.
        """
        prior = increment.mean
        floor = np.square((WHEELS_SIGMA_M, WHEELS_SIGMA_M, WHEELS_SIGMA_RAD))
        covariance = self._trust.scaled(increment.covariance + np.diag(floor))
        if not self._trust.is_as_claimed:
            increment = replace(increment, covariance=self._trust.scaled(increment.covariance))
        search = self._search(now, self._references())
        if search is None or not np.isfinite(covariance).all():
            return increment
        motion, information, count = search.best(prior, covariance + (SLIPPED if only_if_slipped else 0.0), along=True)
        if only_if_slipped:  # the simplest slip that explains the scan: a walker close by pulls the position along
            turned = search.best(prior, covariance + TURNED, along=True)
            if turned[2] >= count - SLIP_GAIN * len(search.points_m):
                motion, information, count = turned
        elif squared_distance(motion - prior, covariance) > SUSPECT_SQUARE:  # they hold the search where it cannot be
            for slip in (SLIPPED, FAR_SLIPPED):
                freed = search.best(prior, covariance + slip, along=True, starts=TURNED_STARTS)
                if freed[2] > count:
                    motion, information, count = freed
        share = count / len(search.points_m)
        if self._usual_fit - share > UNUSUAL_SHARE:
            found = None
            if not only_if_slipped:  # else it was looked for where slipped wheels may have left it
                found = self._found_turned(search, increment, covariance, share)
            if found is None and self._usual_fit - share > POOR_SHARE:
                found = self._found_widely(now, search, increment.mean, covariance)
            if found is not None and not (only_if_slipped and is_too_far(increment, found.motion)):
                self.refined += 1
                self.laid = self._beams(now)
                return corrected(increment, found.motion, found.information, suspected=only_if_slipped)
        is_among_walls = only_if_slipped and self._usual_walls > USUALLY  # and not between bushes, for one scan
        self.is_torn = is_among_walls and not increment.at_rest and self._usual_share - share > TORN_SHARE
        if not only_if_slipped:
            self._usual_fit += USUAL_GAIN * (share - self._usual_fit)
        off = motion - prior
        if count < max(LEAST_POINTS, LEAST_SHARE * len(search.points_m)):
            return increment
        refined = inverse(information)
        square = squared_distance(off, covariance)
        if not only_if_slipped:
            self._trust.compare(off, covariance, refined)
        contradicts = not square <= (SUSPECT_SQUARE if only_if_slipped else WIDEST_SQUARE)  # also where it is NaN
        if contradicts and not self._have_slipped(search, increment, motion, count, suspected=only_if_slipped):
            self.is_disputed = not only_if_slipped and bool(np.isfinite(off).all())
            if not self.is_disputed:
                return increment
            return replace(increment, covariance=increment.covariance + np.outer(off, off))  # either may be right
        if only_if_slipped and (increment.at_rest or not contradicts):  # at rest, what moves is the door
            return increment
        self.refined += 1
        if not only_if_slipped:
            self.laid = self._beams(now)
        return corrected(increment, motion, information, suspected=only_if_slipped)

    def _found_turned(self, search: Search, increment: Increment, covariance: FloatArray, share: float) -> Found | None:
        """The motion, turned more than the wheels admit, with which a scan lies as usual; near theirs it does not."""
        motion, information, count = search.best(increment.mean, covariance + SLIPPED, along=True, starts=TURNED_STARTS)
        its_share = count / len(search.points_m)
        is_usual = its_share > max(share + SLIP_GAIN, self._usual_fit - UNUSUAL_SHARE)
        return Found(motion, information, its_share) if is_usual else None

    def _found_widely(self, now: SeenFrom, search: Search, prior: FloatArray, covariance: FloatArray) -> Found | None:
        """The motion where the scan lies nowhere near the place that the wheels say, but clearly at another; looked
        for at most once in WIDE_PAUSE_NS.
        """
        if self.searched_ns is not None and now.scan.stamp_ns - self.searched_ns < WIDE_PAUSE_NS:
            return None
        self.searched_ns = now.scan.stamp_ns
        views = [View.of(self._beams(seen)) for seen in (now, self._past[-1])]
        found = WideSearch(search, views[0], views[1], self._body_from_laser).best(prior)
        if found is not None and self._known(self._beams(now), prior, covariance):
            found = None
        self.found_widely += found is not None
        return found

    def _have_slipped(
        self, search: Search, increment: Increment, motion: FloatArray, count: int, *, suspected: bool
    ) -> bool:
        """Whether a motion that contradicts the wheels is clearly the better one: wheels slip, and tyres lose grip.

        On what the older scans know of its points, too: since then a walker nearby has moved on, and what stands has
        not. suspected: the wheels are sure of themselves, and the rover cannot have moved much faster than they rolled.
        """
        by_wheels, points, older = increment.mean, len(search.points_m), search.older(LATEST)
        on, by_wheels_on = older.on_surfaces(motion), older.on_surfaces(by_wheels)
        return (
            count >= min(SLIP_SHARE, self._usual_fit - UNUSUAL_SHARE) * points
            and count - search.on_surfaces(by_wheels) >= SLIP_GAIN * points
            and on - by_wheels_on >= SLIP_GAIN * (points if suspected else max(on, by_wheels_on))
            and not (suspected and is_too_far(increment, motion))
        )

    def _references(self) -> list[SeenFrom]:
        """The scan before, and older ones ever farther apart: what they see longest ties the path together."""
        numbers = [1 + number * (number + 1) // 2 for number in range(PAST_SCANS)]
        return [self._past[-number] for number in numbers if number <= len(self._past)]

    def _returned(self, seen: SeenFrom) -> IntArray:
        """Numbers of the beams that came back; none where they are too few to lay the scan onto anything."""
        beams = self._beams(seen)
        returned = np.flatnonzero(~np.isnan(beams.ranges_m))
        return returned if len(returned) >= max(LEAST_POINTS, LEAST_VIEW_RAD / beams.spacing_rad) else returned[:0]

    def _beams(self, seen: SeenFrom) -> Beams:
        if seen.beams is None:
            farthest_m = min(self._settings.range_max_m, sharp_to_m(seen.scan, seen.twist, GATE_LAST_M))
            seen.beams = deskew(seen.scan, seen.twist, self._body_from_laser, self._settings.range_min_m, farthest_m)
        return seen.beams

    def _normals(self, seen: SeenFrom) -> FloatArray:
        if seen.normals is None:
            beams = self._beams(seen)
            seen.normals = np.empty_like(beams.points_m)
            surface_normals(beams.points_m, beams.spacing_rad, seen.normals)
        return seen.normals


def _off_m(covariance: FloatArray) -> float:
    variances = np.diag(covariance)
    return math.sqrt(variances[0] + variances[1]) + NEED_RANGE_M * math.sqrt(variances[2])
