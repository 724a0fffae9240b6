"""Which feature is which landmark, judged by the joint Gaussian: sequential, exclusive, nearest first.

Works on a copy of the pose and the landmarks that can be in view, so that every match moves the pose before the next
feature is looked at.
"""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.angles import wrapped
from slam.arithmetic.functions import logarithm
from slam.compiled import kernel, leaf
from slam.joint.measurement import FIRST_PLACE, JointArrays, fold, innovation_covariance, slopes
from slam.observations import AMBIGUOUS, EXCLUDED, NEW, PENDING, UNLICENSED, FeatureRows, Sighting
from slam.settings.tuning import Tuning
from slam.visibility import sighting_of

MATCH_WIDEST_SQUARE = 13.816  # the widest gate: 99.9 % of true matches
CREATE_SQUARE = 25.0  # a feature nearer than this to a landmark creates none: it may be that landmark
SLIP_SQUARE = 100.0  # gate within which an old landmark is looked for when most are not where the wheels say


class Gates(NamedTuple):
    """Squared Mahalanobis distances; nearest landmark d: match up to clip(base + per_metre d, base, widest).

    create: a feature nearer than this to a landmark creates none. slip: within which an old landmark is looked for when
    most are not where the wheels say.
    """

    match_base: float
    match_per_metre: float
    match_widest: float
    create: float
    slip: float


def gates_of(tuning: Tuning) -> Gates:
    """The gates of the settings."""
    per_metre = tuning.match_per_metre_square if tuning.density else 0.0
    return Gates(tuning.match_square, per_metre, MATCH_WIDEST_SQUARE, CREATE_SQUARE, SLIP_SQUARE)


@leaf
def distance_to(
    mean: FloatArray, covariance: FloatArray, mount: FloatArray, at: int, sighting: Sighting
) -> tuple[float, float]:
    """Squared Mahalanobis distance of a sighting from the landmark at `at`, and the determinant of its covariance."""
    slope = slopes(mean, mount, mean[at], mean[at + 1])
    rr, rb, bb = innovation_covariance(covariance, at, slope)
    rr, rb, bb = rr + sighting.rr, rb + sighting.rb, bb + sighting.bb
    determinant = rr * bb - rb * rb
    range_gap, bearing_gap = sighting.range_m - slope.range_m, wrapped(sighting.bearing_rad - slope.bearing_rad)
    square = bb * range_gap * range_gap - 2.0 * rb * range_gap * bearing_gap + rr * bearing_gap * bearing_gap
    return square / determinant, determinant


@leaf
def gate_of(nearest_m: float, gates: Gates) -> float:
    """The density-adapted threshold (5): strict where landmarks are dense, bounded where one stands alone."""
    return min(gates.match_base + gates.match_per_metre * nearest_m, gates.match_widest)


@kernel
def associate(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    nearest_m: FloatArray,
    features: FeatureRows,
    gates: Gates,
    barred: BoolArray,
    chosen: IntArray,
) -> None:
    """Fill chosen (K,) with landmark numbers or verdicts.

    mean (6 + 2 L,) and covariance are overwritten by the sequential update; nearest_m (L,) is each landmark's distance
    to its nearest neighbour. barred (L,): landmarks that may be found nowhere, though none is created where they are.
    """
    landmarks = nearest_m.size
    used = barred.copy()
    work = np.empty((2, mean.size))
    chosen[:] = PENDING
    for position in range(features.order.size):
        feature = features.order[position]
        while chosen[feature] == PENDING:
            best, best_log, best_square = -1, -math.inf, math.inf
            least, least_excluded = math.inf, False
            for landmark in range(landmarks):
                at = FIRST_PLACE + 2 * landmark
                square, determinant = distance_to(mean, covariance, mount, at, sighting_of(features, feature))
                if square < least:
                    least, least_excluded = square, used[landmark]
                if not used[landmark] and square <= gate_of(nearest_m[landmark], gates):
                    log = -0.5 * (square + logarithm(39.47841760435743 * determinant))  # of (4), with (2 pi)^2
                    if log > best_log:
                        best, best_log, best_square = landmark, log, square
            if best < 0:
                if least < gates.create:
                    chosen[feature] = EXCLUDED if least_excluded else AMBIGUOUS
                else:
                    chosen[feature] = NEW if features.may_create[feature] else UNLICENSED
                break
            at = FIRST_PLACE + 2 * best
            taker = feature
            for later in range(position + 1, features.order.size):
                rival = features.order[later]
                if chosen[rival] == PENDING:
                    square, _ = distance_to(mean, covariance, mount, at, sighting_of(features, rival))
                    if square < best_square:
                        taker, best_square = rival, square
            slope = slopes(mean, mount, mean[at], mean[at + 1])
            fold(mean, covariance, at, slope, sighting_of(features, taker), work)
            chosen[taker] = best
            used[best] = True


@kernel
def expected_within(joint: JointArrays, places: IntArray) -> FloatArray:
    """(k,) sigma m of where the landmarks at places (k,) should be seen, by the pose and the landmarks alone."""
    sigma_m = np.zeros(places.size)
    for index in range(places.size):
        at = places[index]
        slope = slopes(joint.mean, joint.mount, joint.mean[at], joint.mean[at + 1])
        rr, _, bb = innovation_covariance(joint.covariance, at, slope)
        sigma_m[index] = math.sqrt(max(rr + slope.range_m * slope.range_m * bb, 0.0))
    return sigma_m


@kernel
def off_squares(joint: JointArrays, places: IntArray, matched: IntArray, features: FeatureRows) -> FloatArray:
    """(k,) m^2, how far features matched (k,) may lie from where their landmarks at places (k,) should be seen, by the
    pose and the landmarks alone, or do, whichever is more.
    """
    squares: FloatArray = np.square(expected_within(joint, places))
    for index in range(places.size):
        at = places[index]
        slope = slopes(joint.mean, joint.mount, joint.mean[at], joint.mean[at + 1])
        along = features.ranges_m[matched[index]] - slope.range_m
        across = slope.range_m * wrapped(features.bearings_rad[matched[index]] - slope.bearing_rad)
        squares[index] = max(squares[index], along * along + across * across)
    return squares


@kernel
def lie_near(joint: JointArrays, places: IntArray, features: FeatureRows, gate: float) -> BoolArray:
    """(k,) at which of the landmarks at places (k,) a feature lies within the gate, whatever it was matched with."""
    near = np.zeros(places.size, dtype=np.bool_)
    for landmark in range(places.size):
        for feature in features.order:
            sighting = sighting_of(features, feature)
            square, _ = distance_to(joint.mean, joint.covariance, joint.mount, places[landmark], sighting)
            if square <= gate:
                near[landmark] = True
                break
    return near


@kernel
def associate_by_hint(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    identities: IntArray,
    features: FeatureRows,
    hints: IntArray,
    gate: float,
    chosen: IntArray,
) -> None:
    """Fill chosen (K,) with the landmarks that hints (K,) name, as far as they pass the gate.

    hints: an identity, or a verdict, which stands. An identity that is not among identities (L,) starts a landmark.
    mean and covariance are overwritten by the sequential update.
    """
    used = np.zeros(identities.size, dtype=np.bool_)
    work = np.empty((2, mean.size))
    for feature in features.order:
        chosen[feature] = hints[feature]
        if hints[feature] < 0:
            continue
        chosen[feature] = NEW if features.may_create[feature] else UNLICENSED
        sighting = sighting_of(features, feature)
        for landmark in range(identities.size):
            if identities[landmark] == hints[feature]:
                at = FIRST_PLACE + 2 * landmark
                square, _ = distance_to(mean, covariance, mount, at, sighting)
                if used[landmark] or square > gate:
                    chosen[feature] = EXCLUDED if used[landmark] else AMBIGUOUS
                    break
                fold(mean, covariance, at, slopes(mean, mount, mean[at], mean[at + 1]), sighting, work)
                chosen[feature] = landmark
                used[landmark] = True
                break


@kernel
def nearest_old(
    joint: JointArrays, places: IntArray, old: BoolArray, features: FeatureRows, gate: float
) -> tuple[IntArray, FloatArray]:
    """(K,) the nearest of the old (k,) landmarks at places (k,) within the gate, -1 where there is none.

    And (K,) its squared Mahalanobis distance before anything of the scan is folded in, else inf.
    """
    best, squares = np.full(features.ranges_m.size, -1), np.full(features.ranges_m.size, math.inf)
    for feature in range(features.ranges_m.size):
        sighting = sighting_of(features, feature)
        for landmark in range(places.size):
            if old[landmark]:
                square, _ = distance_to(joint.mean, joint.covariance, joint.mount, places[landmark], sighting)
                if square <= gate and square < squares[feature]:
                    best[feature], squares[feature] = landmark, square
    return best, squares


@kernel
def apply_hypothesis(
    mean: FloatArray, covariance: FloatArray, mount: FloatArray, landmark: int, sighting: Sighting
) -> None:
    """Fold one sighting of this landmark into mean (6 + 2 L,) and covariance, whatever the distance: if that is what it
    was, the wheels have slipped by so much.
    """
    at = FIRST_PLACE + 2 * landmark
    fold(mean, covariance, at, slopes(mean, mount, mean[at], mean[at + 1]), sighting, np.empty((2, mean.size)))
