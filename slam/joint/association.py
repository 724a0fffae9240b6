"""Which feature is which landmark, judged by the joint Gaussian: sequential, exclusive, nearest first.

Works on a copy of the pose and the landmarks that can be in view, so that every match moves the pose before the next
feature is looked at.
"""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.angles import wrapped
from slam.compiled import kernel, leaf
from slam.joint.measurement import FIRST_PLACE, fold, innovation_covariance, slopes

NEW, UNLICENSED, AMBIGUOUS, EXCLUDED = -1, -2, -3, -4
PENDING = -100


class Gates(NamedTuple):
    """Squared Mahalanobis distances; nearest landmark d: match up to clip(base + per_metre d, base, widest)."""

    match_base: float
    match_per_metre: float
    match_widest: float
    create: float


@leaf
def distance_to(
    mean: FloatArray, covariance: FloatArray, mount: FloatArray, at: int, feature: FloatArray
) -> tuple[float, float]:
    """Squared Mahalanobis distance of a feature to the landmark at `at`, and the determinant of its covariance."""
    slope = slopes(mean, mount, mean[at], mean[at + 1])
    rr, rb, bb = innovation_covariance(covariance, at, slope)
    rr, rb, bb = rr + feature[2], rb + feature[3], bb + feature[4]
    determinant = rr * bb - rb * rb
    range_gap, bearing_gap = feature[0] - slope.range_m, wrapped(feature[1] - slope.bearing_rad)
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
    features: FloatArray,
    order: IntArray,
    gates: Gates,
    chosen: IntArray,
) -> None:
    """Fill chosen (K,) with landmark numbers or verdicts.

    mean (6 + 2 L,) and covariance are overwritten by the sequential update; nearest_m (L,) is each landmark's distance
    to its nearest neighbour; features (K, 6): range, bearing, rr, rb, bb, licence.
    """
    landmarks = nearest_m.size
    used = np.zeros(landmarks, dtype=np.bool_)
    work = np.empty((2, mean.size))
    chosen[:] = PENDING
    for position in range(order.size):
        feature = order[position]
        while chosen[feature] == PENDING:
            best, best_log, best_square = -1, -math.inf, math.inf
            least, least_excluded = math.inf, False
            for landmark in range(landmarks):
                at = FIRST_PLACE + 2 * landmark
                square, determinant = distance_to(mean, covariance, mount, at, features[feature])
                if square < least:
                    least, least_excluded = square, used[landmark]
                if not used[landmark] and square <= gate_of(nearest_m[landmark], gates):
                    log = -0.5 * (square + math.log(39.47841760435743 * determinant))  # of (4), with (2 pi)^2
                    if log > best_log:
                        best, best_log, best_square = landmark, log, square
            if best < 0:
                if least < gates.create:
                    chosen[feature] = EXCLUDED if least_excluded else AMBIGUOUS
                else:
                    chosen[feature] = NEW if features[feature, 5] > 0.0 else UNLICENSED
                break
            at = FIRST_PLACE + 2 * best
            taker = feature
            for later in range(position + 1, order.size):
                rival = order[later]
                if chosen[rival] == PENDING:
                    square, _ = distance_to(mean, covariance, mount, at, features[rival])
                    if square < best_square:
                        taker, best_square = rival, square
            slope = slopes(mean, mount, mean[at], mean[at + 1])
            fold(mean, covariance, at, slope, features[taker], work)
            chosen[taker] = best
            used[best] = True


@kernel
def follow(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    identities: IntArray,
    features: FloatArray,
    order: IntArray,
    told: IntArray,
    gate: float,
    chosen: IntArray,
) -> None:
    """Fill chosen (K,) with the landmarks that somebody else told (K,), as far as they pass the gate.

    told: an identity, or a verdict, which stands. An identity that is not among identities (L,) starts a landmark. mean
    and covariance are overwritten by the sequential update.
    """
    used = np.zeros(identities.size, dtype=np.bool_)
    work = np.empty((2, mean.size))
    for position in range(order.size):
        feature = order[position]
        chosen[feature] = told[feature]
        if told[feature] < 0:
            continue
        chosen[feature] = NEW if features[feature, 5] > 0.0 else UNLICENSED
        for landmark in range(identities.size):
            if identities[landmark] == told[feature]:
                at = FIRST_PLACE + 2 * landmark
                square, _ = distance_to(mean, covariance, mount, at, features[feature])
                if used[landmark] or square > gate:
                    chosen[feature] = EXCLUDED if used[landmark] else AMBIGUOUS
                    break
                fold(mean, covariance, at, slopes(mean, mount, mean[at], mean[at + 1]), features[feature], work)
                chosen[feature] = landmark
                used[landmark] = True
                break


@kernel
def nearest_old(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    places: IntArray,
    old: BoolArray,
    features: FloatArray,
    gate: float,
    best: IntArray,
    squares: FloatArray,
) -> None:
    """Fill best (K,) with the nearest of the old (k,) landmarks at places (k,) within the gate, -1 where there is none.

    squares (K,): its squared Mahalanobis distance before anything of the scan is folded in, else inf.
    """
    best[:] = -1
    squares[:] = math.inf
    for feature in range(features.shape[0]):
        for landmark in range(places.size):
            if old[landmark]:
                square, _ = distance_to(mean, covariance, mount, places[landmark], features[feature])
                if square <= gate and square < squares[feature]:
                    best[feature], squares[feature] = landmark, square


@kernel
def presume(mean: FloatArray, covariance: FloatArray, mount: FloatArray, landmark: int, feature: FloatArray) -> None:
    """Fold one feature of this landmark into mean (6 + 2 L,) and covariance, whatever the distance."""
    at = FIRST_PLACE + 2 * landmark
    fold(mean, covariance, at, slopes(mean, mount, mean[at], mean[at + 1]), feature, np.empty((2, mean.size)))
