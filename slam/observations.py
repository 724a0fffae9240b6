"""What a front end hands to the filter: point features of one scan, in the laser's frame."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray, VerdictArray
from slam.arithmetic.elementary import squared
from slam.pose import wrap_rads

MOST_FEATURES = 64  # of a scan are matched, the most exact ones; real scans have 50 at most, and 256 took 200 ms
IDENTITIES_PER_SCAN = 4096  # a landmark is named by the scan that made it, times this, plus the feature's number


class BeamVerdict(IntEnum):
    """What the front end thought of one beam; recorded so that a reviewer sees why a point was not used."""

    KEPT = 0
    NO_RETURN = 1
    MOVED = 2
    NOT_COMPARED = 3


class MatchVerdict(IntEnum):
    """What became of one feature in the best particle; a match is the landmark's identity, 0 or more."""

    NEW = -1
    UNLICENSED = -2
    AMBIGUOUS = -3
    EXCLUDED = -4
    OUT_OF_RANGE = -5


# the same as plain numbers, which compiled code takes; PENDING: not decided yet
NEW, UNLICENSED, AMBIGUOUS, EXCLUDED, OUT_OF_RANGE = (int(verdict) for verdict in MatchVerdict)
PENDING = -100


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Point features of one scan, already corrected for the rover's motion during the sweep.

    ranges_m, bearings_rad: (K,) in the laser's frame at stamp_ns.
    covariances: (K, 2, 2) of (range, bearing).
    may_create: (K,) True where difference or vote licenses a new landmark; any feature may match.
    identities: (K,) -1 where unknown.
    beams: (K,) index of the beam nearest the feature, -1 where there is none.
    """

    stamp_ns: int
    ranges_m: FloatArray
    bearings_rad: FloatArray
    covariances: FloatArray
    may_create: BoolArray
    identities: IntArray
    beams: IntArray

    def __len__(self) -> int:
        return int(self.ranges_m.shape[0])


class Sighting(NamedTuple):
    """What the sensor says of one thing: range m, bearing rad, and their covariance m^2, m rad, rad^2."""

    range_m: float
    bearing_rad: float
    rr: float
    rb: float
    bb: float


class FeatureRows(NamedTuple):
    """The usable features of one scan as both filters and their compiled code take them, (K,) each.

    ranges_m, bearings_rad; rr m^2, rb m rad, bb rad^2: their covariances. ahead, left: unit vector towards the feature
    in the body's axes. may_create, identities: as in Features. numbers: which of the Features each one is.
    order: in which they are associated, nearest first.
    """

    ranges_m: FloatArray
    bearings_rad: FloatArray
    rr: FloatArray
    rb: FloatArray
    bb: FloatArray
    ahead: FloatArray
    left: FloatArray
    may_create: BoolArray
    identities: IntArray
    numbers: IntArray
    order: IntArray


LASTING_M, LEAST_STEP_M = 1.0, 0.05  # on this way a thing is seen from one side; a look adds no less than the latter
SMALLEST = 1e-12

_NONE, _NO_NUMBERS = np.zeros(0), np.zeros(0, dtype=np.int64)
NO_FEATURES = FeatureRows(
    *(_NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE),
    np.zeros(0, dtype=np.bool_),
    *(_NO_NUMBERS, _NO_NUMBERS, _NO_NUMBERS),
)


def usable_rows(features: Features, range_max_m: float, mount_yaw_rad: float) -> FeatureRows:
    """Features that are finite, within range, and have a positive definite covariance; the most exact if they are many.

    mount_yaw_rad: heading of the laser on the body.
    """
    from slam.arithmetic.functions import (
        cosines_sines,  # brings the compiler, which who only reads features does not need
    )

    c = features.covariances
    with np.errstate(invalid="ignore"):
        determinants = c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] * c[:, 1, 0]
        finite = np.isfinite(features.ranges_m) & np.isfinite(features.bearings_rad) & np.isfinite(determinants)
        definite = (c[:, 0, 0] > 0.0) & (determinants > 0.0)
        near = (features.ranges_m > 0.0) & (features.ranges_m <= range_max_m)
    usable = np.flatnonzero(finite & definite & near)
    if len(usable) > MOST_FEATURES:
        spread = c[usable, 0, 0] + np.square(features.ranges_m[usable]) * c[usable, 1, 1]
        usable = np.sort(usable[np.argsort(spread, kind="stable")[:MOST_FEATURES]])
    c, ranges, bearings = c[usable], features.ranges_m[usable], wrap_rads(features.bearings_rad[usable])
    ahead, left = cosines_sines(bearings + mount_yaw_rad)
    return FeatureRows(
        ranges,
        bearings,
        c[:, 0, 0].copy(),
        0.5 * (c[:, 0, 1] + c[:, 1, 0]),
        c[:, 1, 1].copy(),
        ahead,
        left,
        features.may_create[usable],
        features.identities[usable],
        usable,
        np.argsort(ranges, kind="stable"),
    )


def as_repeated(
    rows: FeatureRows, matched: IntArray, off_squares: FloatArray, way_m: float, lasting: tuple[float, float]
) -> FeatureRows:
    """Rows of which the matched ones (k,) are so uncertain that all looks on LASTING_M of way tell as much as one.

    off_squares (k,) m^2: how far each may lie from where it should be seen, or does; where that is more than what
    lasts, it is looked at anew. way_m: since the looks before. lasting: the part of the error, standard deviations of
    range and bearing, that stays the same on that way: which edge of a thing is seen, and between which beams.
    """
    rr, bb = rows.rr.copy(), rows.bb.copy()
    along, across = np.minimum(squared(lasting[0]), rr[matched]), np.minimum(squared(lasting[1]), bb[matched])
    square_m = along + np.square(rows.ranges_m[matched]) * across
    more = (LASTING_M / min(max(way_m, LEAST_STEP_M), LASTING_M) - 1.0) * square_m
    more = more / np.maximum(np.maximum(square_m, off_squares), SMALLEST)
    rr[matched] += more * along
    bb[matched] += more * across
    return rows._replace(rr=rr, bb=bb)


def verdicts_of_all(rows: FeatureRows, verdicts: IntArray, count: int) -> IntArray:
    """Verdicts (K,) of the usable features spread over all `count` features; OUT_OF_RANGE for the others."""
    everyone = np.full(count, int(MatchVerdict.OUT_OF_RANGE), dtype=np.int64)
    everyone[rows.numbers] = verdicts
    return everyone


def match_figures(matches: IntArray) -> dict[str, float]:
    """Of the verdicts (K,) of all features, for the record."""
    count = len(matches)
    left_out = max(count - MOST_FEATURES, 0)
    return {"features": float(count), "features_left_out": float(left_out), "matched": float((matches >= 0).sum())}


def seen_before_share(verdicts: VerdictArray) -> float | None:
    """Of the beams (n,) with a return, how many were seen by earlier scans too: all where none could be compared, None
    where nothing came back.
    """
    kept, moved, other = (
        int((verdicts == v).sum()) for v in (BeamVerdict.KEPT, BeamVerdict.MOVED, BeamVerdict.NOT_COMPARED)
    )
    if kept + moved:
        return kept / (kept + moved)
    return 1.0 if other else None
