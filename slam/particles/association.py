"""Data association in one particle: which landmark each feature is, and what that does to the pose.

Sequential: nearest feature first, every match folded into the pose before the next feature is looked at.
Simultaneous: the printed form, all features against the predicted pose. Known: by the identity that the sensor reports.
"""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.functions import cosine_sine
from slam.compiled import inlined, kernel, leaf
from slam.observations import AMBIGUOUS, EXCLUDED, NEW, PENDING, UNLICENSED, FeatureRows, Sighting
from slam.particles.gates import (
    GATE_BLOCK,
    accepts,
    all_outside,
    gate_columns,
    largest_variance,
    moments_of,
)
from slam.particles.proposals import Moments, PoseBelief, fold_in, log_likelihood, squared_distance, with_noise
from slam.settings.tuning import Strategy, Tuning
from slam.unscented import pose_root_into
from slam.visibility import sighting_of

SEQUENTIAL, KNOWN = int(Strategy.SEQUENTIAL), int(Strategy.KNOWN)


class Candidates(NamedTuple):
    """One particle's landmarks that may be in view: landmarks (C, 6), identities (C,), columns as `gate_columns` makes
    them, and used (C,): which of them a feature has taken.
    """

    landmarks: FloatArray
    identities: IntArray
    columns: FloatArray
    used: BoolArray


@kernel
def candidates_of(landmarks: FloatArray, identities: IntArray) -> Candidates:
    """Candidates of which none is taken."""
    return Candidates(landmarks, identities, gate_columns(landmarks), np.zeros(landmarks.shape[0], dtype=np.bool_))


@inlined
def best_landmark(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    sighting: Sighting,
    direction: tuple[float, float],
    tuning: Tuning,
    bound: float,
) -> tuple[int, float, Moments, int, float, int]:
    """The likeliest free landmark by (4), its squared distance and prediction; then, over all landmarks, the
    likeliest and the least squared distance; and how many likelihoods that took. -1 stands for none. direction:
    unit vector from the sensor to the feature, in the body's axes.
    """
    pose, landmarks = belief.pose, candidates.landmarks
    cosine, sine = cosine_sine(pose[2])
    ahead, left = mount[0] + sighting.range_m * direction[0], mount[1] + sighting.range_m * direction[1]
    x, y = pose[0] + cosine * ahead - sine * left, pose[1] + sine * ahead + cosine * left
    variance = largest_variance(belief.covariance, sighting)
    free, free_distance, free_log = -1, math.inf, -math.inf
    free_moments = Moments(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    likeliest, likeliest_log, least, evaluated = -1, -math.inf, math.inf, 0
    for first in range(0, landmarks.shape[0], GATE_BLOCK):
        if tuning.range_gate and all_outside(candidates.columns, first, x, y, variance, bound):
            continue
        for index in range(first, min(first + GATE_BLOCK, landmarks.shape[0])):
            if tuning.range_gate:
                dx, dy = landmarks[index, 0] - x, landmarks[index, 1] - y
                if dx * dx + dy * dy > bound * (variance + landmarks[index, 2] + landmarks[index, 4]):
                    continue
            moments = moments_of(belief, mount, landmarks[index], sighting, tuning)
            evaluated += 1
            distance = squared_distance(moments, sighting)
            if not distance < math.inf:
                continue
            log = log_likelihood(moments, distance)
            least = min(least, distance)
            if log > likeliest_log:
                likeliest, likeliest_log = index, log
            if not candidates.used[index] and log > free_log:
                free, free_log, free_distance, free_moments = index, log, distance, moments
    return free, free_distance, free_moments, likeliest, least, evaluated


@leaf
def verdict_without_match(licensed: bool, least: float, excluded: bool, tuning: Tuning) -> int:
    """What becomes of a feature that matched nothing: EXCLUDED may still create, AMBIGUOUS and UNLICENSED may not."""
    if tuning.density and least < tuning.create_square:
        return EXCLUDED if excluded else AMBIGUOUS
    return NEW if licensed else UNLICENSED


@kernel
def associate_sequentially(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    features: FeatureRows,
    tuning: Tuning,
    chosen: IntArray,
) -> tuple[float, int]:
    """Fill chosen (K,) with numbers of candidates or verdicts; the pose follows match by match.

    When another open feature fits the landmark better than the one at hand, that one goes first: the best keeps it.
    Returns the log weight of this particle's step and the number of likelihoods.
    """
    landmarks, used = candidates.landmarks, candidates.used
    widest = max(tuning.match_widest_square, tuning.create_square) if tuning.density else tuning.match_fixed_square
    log_weight, evaluated = 0.0, 0
    chosen[:] = PENDING
    pose_root_into(belief.covariance, belief.root)
    largest_rr = 0.0
    for feature in range(features.order.size):
        largest_rr = max(largest_rr, features.rr[feature])
    for position in range(features.order.size):
        feature = features.order[position]
        while chosen[feature] == PENDING:
            sighting = sighting_of(features, feature)
            free, distance, moments, likeliest, least, looked = best_landmark(
                belief,
                mount,
                candidates,
                sighting,
                (features.ahead[feature], features.left[feature]),
                tuning,
                widest,
            )
            evaluated += looked
            if free < 0 or not accepts(distance, landmarks, free, tuning):
                excluded = likeliest >= 0 and used[likeliest] and accepts(least, landmarks, likeliest, tuning)
                chosen[feature] = verdict_without_match(features.may_create[feature], least, excluded, tuning)
                log_weight += tuning.log_unmatched
                break
            taker = feature
            for later in range(position + 1, features.order.size):
                rival = features.order[later]
                gap = abs(features.ranges_m[rival] - features.ranges_m[feature])
                if gap * gap >= widest * 4.0 * (sighting.rr + largest_rr) + 1.0:
                    break  # the others are farther still
                if chosen[rival] == PENDING and gap * gap < widest * 4.0 * (sighting.rr + features.rr[rival]) + 1.0:
                    claim = sighting_of(features, rival)
                    rival_distance = squared_distance(with_noise(moments, sighting, claim), claim)
                    if rival_distance < distance:
                        taker, distance = rival, rival_distance
            winner = sighting_of(features, taker)
            moments = with_noise(moments, sighting, winner)
            log_weight += log_likelihood(moments, squared_distance(moments, winner))
            fold_in(belief, moments, winner)
            pose_root_into(belief.covariance, belief.root)
            chosen[taker] = free
            used[free] = True
    return log_weight, evaluated


@kernel
def fold_all(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    features: FeatureRows,
    tuning: Tuning,
    chosen: IntArray,
) -> float:
    """Fold matches that are already decided into the pose, new sigma points for each; returns the log weight."""
    log_weight = 0.0
    for position in range(features.order.size):
        feature = features.order[position]
        if chosen[feature] < 0:
            log_weight += tuning.log_unmatched
            continue
        sighting = sighting_of(features, feature)
        pose_root_into(belief.covariance, belief.root)
        moments = moments_of(belief, mount, candidates.landmarks[chosen[feature]], sighting, tuning)
        distance = squared_distance(moments, sighting)
        if distance < math.inf:
            log_weight += log_likelihood(moments, distance)
            fold_in(belief, moments, sighting)
    return log_weight


@kernel
def associate_simultaneously(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    features: FeatureRows,
    tuning: Tuning,
    chosen: IntArray,
) -> int:
    """The printed form of (4): every feature takes its likeliest landmark as seen from the predicted pose.

    With exclusivity the likeliest claim keeps a landmark and the other features count as new. Fills chosen (K,),
    returns the number of likelihoods.
    """
    count = features.ranges_m.size
    distances = np.empty(count)
    widest = max(tuning.match_widest_square, tuning.create_square) if tuning.density else tuning.match_fixed_square
    pose_root_into(belief.covariance, belief.root)
    evaluated = 0
    for feature in range(count):
        free, distance, _, _, least, looked = best_landmark(
            belief,
            mount,
            candidates,
            sighting_of(features, feature),
            (features.ahead[feature], features.left[feature]),
            tuning,
            widest,
        )
        evaluated += looked
        distances[feature] = distance
        if free >= 0 and accepts(distance, candidates.landmarks, free, tuning):
            chosen[feature] = free
        else:
            chosen[feature] = verdict_without_match(features.may_create[feature], least, False, tuning)
    if tuning.exclusivity:
        for feature in range(count):
            for rival in range(count):
                if rival != feature and chosen[feature] >= 0 and chosen[rival] == chosen[feature]:
                    loser = rival if distances[feature] <= distances[rival] else feature
                    chosen[loser] = verdict_without_match(features.may_create[loser], distances[loser], True, tuning)
    return evaluated


@kernel
def associate_by_identity(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    features: FeatureRows,
    tuning: Tuning,
    chosen: IntArray,
) -> int:
    """Match equal identities inside a wide gate; a feature without identity is left alone. Returns the likelihoods."""
    pose_root_into(belief.covariance, belief.root)
    evaluated = 0
    for feature in range(features.ranges_m.size):
        chosen[feature] = NEW if features.identities[feature] >= 0 else UNLICENSED
        for index in range(candidates.identities.size):
            if features.identities[feature] >= 0 and candidates.identities[index] == features.identities[feature]:
                sighting = sighting_of(features, feature)
                moments = moments_of(belief, mount, candidates.landmarks[index], sighting, tuning)
                evaluated += 1
                matches = squared_distance(moments, sighting) <= tuning.match_known_square
                chosen[feature] = index if matches else AMBIGUOUS
    return evaluated


@kernel
def associate(
    belief: PoseBelief,
    mount: FloatArray,
    candidates: Candidates,
    features: FeatureRows,
    tuning: Tuning,
    chosen: IntArray,
) -> tuple[float, int]:
    """Fill chosen (K,) by the strategy in force and fold every match into the pose, in place.

    Returns the log weight of this particle's step and the number of likelihoods.
    """
    if tuning.strategy == SEQUENTIAL:
        return associate_sequentially(belief, mount, candidates, features, tuning, chosen)
    if tuning.strategy == KNOWN:
        evaluated = associate_by_identity(belief, mount, candidates, features, tuning, chosen)
    else:
        evaluated = associate_simultaneously(belief, mount, candidates, features, tuning, chosen)
    return fold_all(belief, mount, candidates, features, tuning, chosen), evaluated
