"""From one scan to point features: the seam, and the three front ends behind it."""

from typing import Protocol

import numpy as np

from drivers.measurements import FloatArray, IntArray, Scan, ScanLike, Sightings, VerdictArray
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import cosines_sines
from slam.front_end.corners import corners
from slam.front_end.deskew import Beams, Twist, deskew
from slam.front_end.differencing import DIFFERENCE_M, CompensatedVote, PlacedScan, equal_angle_difference
from slam.front_end.spacing import SPACING_M, range_extrema, spaced
from slam.front_end.stillness import Stillness
from slam.front_end.trunks import holes_in, runs_of_beams, trunk_variances, trunks
from slam.observations import BeamVerdict, Features
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings


class FrontEnd(Protocol):
    """Finds point features in scans; remembers earlier scans, so every scan is shown to it once and in order."""

    def observe(
        self, scan: ScanLike, odom_from_body: Pose2, twist: Twist, stands: bool
    ) -> tuple[Features, VerdictArray]:
        """Features of the scan and a BeamVerdict for each of its beams (n,).

        odom_from_body: dead-reckoned pose at the scan's stamp. twist: velocity during the sweep. stands: the wheels
        do; then only what has stood for long may create a landmark.
        Raises TypeError for a kind of scan that this front end is not made for.
        """


def make_front_end(settings: FrontEndSettings, *, difference: bool, sparse: bool, body_from_laser: Pose2) -> FrontEnd:
    """The front end that the settings name, with techniques 1 (difference) and 2 (sparse) on or off."""
    if settings.kind == "given":
        return GivenFrontEnd(settings)
    if settings.kind == "paper":
        return PaperFrontEnd(settings, difference, sparse)
    return RobustFrontEnd(settings, difference, sparse, body_from_laser)


class GivenFrontEnd:
    """Sightings as they come: the sensor has done the work."""

    def __init__(self, settings: FrontEndSettings) -> None:
        self._settings = settings

    def observe(
        self,
        scan: ScanLike,
        odom_from_body: Pose2,  # noqa: ARG002
        twist: Twist,  # noqa: ARG002
        stands: bool,  # noqa: ARG002
    ) -> tuple[Features, VerdictArray]:
        """Sightings with finite values become features; all may create."""
        if not isinstance(scan, Sightings):
            raise TypeError("front_end.kind = given needs sightings, but this is a laser scan: choose robust or paper")
        usable = np.isfinite(scan.ranges_m) & np.isfinite(scan.bearings_rad) & (scan.ranges_m > 0.0)
        ranges, count = scan.ranges_m[usable], int(usable.sum())
        features = Features(
            scan.stamp_ns,
            ranges,
            scan.bearings_rad[usable],
            _equal_covariances(count, self._settings),
            np.ones(count, dtype=np.bool_),
            scan.identities[usable],
            np.full(count, -1, dtype=np.int64),
        )
        return features, np.empty(0, dtype=np.uint8)


class PaperFrontEnd:
    """III-A as printed: equal-angle difference of two consecutive scans, then range extrema at a least spacing."""

    def __init__(self, settings: FrontEndSettings, difference: bool, sparse: bool) -> None:
        self._settings = settings
        self._difference = difference
        self._sparse = sparse
        self._before: Scan | None = None

    def observe(
        self,
        scan: ScanLike,
        odom_from_body: Pose2,  # noqa: ARG002
        twist: Twist,  # noqa: ARG002
        stands: bool,  # noqa: ARG002
    ) -> tuple[Features, VerdictArray]:
        """Only beams that pass the difference are looked at, so every feature may create."""
        settings, scan = self._settings, _laser_scan(scan)
        before, self._before = self._before, scan
        if not self._difference:
            before = None
        verdicts = equal_angle_difference(scan, before, DIFFERENCE_M)
        ranges = scan.ranges_m.astype(np.float64)
        limit = min(settings.range_max_m, scan.range_max_m)
        usable = (ranges >= settings.range_min_m) & (ranges < limit)
        verdicts[~usable] = BeamVerdict.NO_RETURN
        usable &= verdicts != BeamVerdict.MOVED
        beams = range_extrema(ranges, usable)
        if self._sparse and beams.size:
            points = _points(ranges[beams], scan.bearings_rad[beams])
            beams = beams[spaced(points, np.arange(beams.size), SPACING_M)]
        features = Features(
            scan.stamp_ns,
            ranges[beams],
            scan.bearings_rad[beams],
            _equal_covariances(beams.size, settings),
            np.ones(beams.size, dtype=np.bool_),
            np.full(beams.size, -1, dtype=np.int64),
            beams,
        )
        return features, verdicts


class RobustFrontEnd:
    """Trunks, posts and corners of walls; the vote of earlier scans only licenses the creation of landmarks."""

    def __init__(self, settings: FrontEndSettings, difference: bool, sparse: bool, body_from_laser: Pose2) -> None:
        self._settings = settings
        self._sparse = sparse
        self._body_from_laser = body_from_laser
        self._vote = CompensatedVote() if difference else None
        self._stillness = Stillness()

    def observe(
        self, scan: ScanLike, odom_from_body: Pose2, twist: Twist, stands: bool
    ) -> tuple[Features, VerdictArray]:
        """All features may match; those on beams that the vote found again may create, and at rest those that have long
        been still.

        Where no scan is old enough and young enough to compare with, all may create: in the first moments of a run, and
        where scans are seconds apart, which slam.alignment lays onto each other before they come here.
        """
        settings, scan = self._settings, _laser_scan(scan)
        beams = deskew(scan, twist, self._body_from_laser, settings.range_min_m, settings.range_max_m)
        rows, extents = self._features(beams)
        count = len(rows)
        licensed = np.ones(count, dtype=np.bool_)
        if self._vote is None:
            empty = np.isnan(beams.ranges_m)
            verdicts = np.where(empty, BeamVerdict.NO_RETURN, BeamVerdict.NOT_COMPARED).astype(np.uint8)
        else:
            points = _points(rows[:, 0], rows[:, 1])
            vote = self._vote.ask(PlacedScan(beams, points, odom_from_body @ self._body_from_laser))
            verdicts = vote.verdicts
            self._stillness.follow(beams.ranges_m, scan.stamp_ns, stands=stands)
            if stands:
                licensed = self._stillness.licences(beams.ranges_m, scan.stamp_ns, extents)
            elif vote.voters:
                licensed = vote.licences(extents)
        covariances = np.empty((count, 2, 2))
        covariances[:, 0, 0], covariances[:, 1, 1] = rows[:, 2], rows[:, 4]
        covariances[:, 0, 1] = covariances[:, 1, 0] = rows[:, 3]
        return (
            Features(
                scan.stamp_ns,
                rows[:, 0].copy(),
                rows[:, 1].copy(),
                covariances,
                licensed,
                np.full(count, -1, dtype=np.int64),
                _beams_between(beams, extents),
            ),
            verdicts,
        )

    def _features(self, beams: Beams) -> tuple[FloatArray, IntArray]:
        """Rows (k, 5) range, bearing, variance, covariance, variance, and (k, 2) first and last beam."""
        settings = self._settings
        holes = holes_in(beams)
        runs = runs_of_beams(beams, holes)
        narrow = trunks(beams, runs, settings, holes)
        variances = trunk_variances(narrow, beams.spacing_rad, settings)
        rows = np.column_stack((narrow[:, :2], variances[:, 0], np.zeros(len(narrow)), variances[:, 1]))
        extents = narrow[:, 4:6]
        if settings.wall_corners:
            is_trunk = np.zeros(len(runs), dtype=np.bool_)
            is_trunk[np.searchsorted(runs[:, 0], narrow[:, 4], side="right") - 1] = True
            walls = corners(beams, runs[~is_trunk], settings, holes)
            floor = (squared(settings.sigma_range_floor_m), 0.0, squared(settings.sigma_bearing_floor_rad))
            walls[:, 2:5] += floor
            rows, extents = np.vstack((rows, walls[:, :5])), np.vstack((extents, walls[:, 5:7]))
        if self._sparse and len(rows):
            order = np.argsort(rows[:, 2] + np.square(rows[:, 0]) * rows[:, 4], kind="stable")
            kept = spaced(_points(rows[:, 0], rows[:, 1]), order, SPACING_M)
            rows, extents = rows[kept], extents[kept]
        return rows, extents.astype(np.int64)


def _laser_scan(scan: ScanLike) -> Scan:
    if not isinstance(scan, Scan):
        raise TypeError("front_end.kind = robust or paper needs laser scans, but these are sightings: choose given")
    return scan


def _points(ranges_m: FloatArray, bearings_rad: FloatArray) -> FloatArray:
    cosines, sines = cosines_sines(bearings_rad)
    return np.stack((ranges_m * cosines, ranges_m * sines), axis=-1)


def _equal_covariances(count: int, settings: FrontEndSettings) -> FloatArray:
    range_variance = squared(settings.sigma_range_m) + squared(settings.sigma_range_floor_m)
    bearing_variance = squared(settings.sigma_bearing_rad) + squared(settings.sigma_bearing_floor_rad)
    return np.tile(np.diag((range_variance, bearing_variance)), (count, 1, 1))


def _beams_between(beams: Beams, extents: IntArray) -> IntArray:
    """(k,) the middle beam of each extent, or its first where the middle one is empty."""
    middle = extents.sum(axis=1) // 2
    chosen: IntArray = np.where(np.isnan(beams.ranges_m[middle]), extents[:, 0], middle)
    return chosen
