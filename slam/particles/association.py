"""Data association in one particle: which landmark each feature is, and what that does to the pose.

Sequential: nearest feature first, every match folded into the pose before the next feature is looked at.
Simultaneous: the printed form, all features against the predicted pose. Known: by the identity that the sensor reports.
"""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import inlined, kernel, leaf
from slam.particles.gates import (
    GATE_BLOCK,
    accepts,
    all_outside,
    gate_columns,
    largest_variance,
    moments_of,
    sighting_of,
)
from slam.particles.proposals import Moments, Sighting, fold_in, log_likelihood, squared_distance, with_noise
from slam.settings.tuning import Proposal, Tuning
from slam.unscented import pose_root_into

NEW, UNLICENSED, AMBIGUOUS, EXCLUDED, OUT_OF_RANGE = -1, -2, -3, -4, -5
PENDING = -100
UNSCENTED = int(Proposal.UNSCENTED)


@inlined
def best_landmark(
    pose: FloatArray,
    covariance: FloatArray,
    root: FloatArray,
    mount: FloatArray,
    candidates: FloatArray,
    columns: FloatArray,
    used: BoolArray,
    sighting: Sighting,
    direction: tuple[float, float],
    tuning: Tuning,
    bound: float,
) -> tuple[int, float, Moments, int, float, int]:
    """The likeliest free landmark by (4), its squared distance and prediction; then, over all landmarks, the
    likeliest and the least squared distance; and how many likelihoods that took. -1 stands for none. direction:
    unit vector from the sensor to the feature, in the body's axes.
    """
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    ahead, left = mount[0] + sighting.range_m * direction[0], mount[1] + sighting.range_m * direction[1]
    x, y = pose[0] + cosine * ahead - sine * left, pose[1] + sine * ahead + cosine * left
    variance = largest_variance(covariance, sighting)
    free, free_distance, free_log = -1, math.inf, -math.inf
    free_moments = Moments(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    likeliest, likeliest_log, least, evaluated = -1, -math.inf, math.inf, 0
    for first in range(0, candidates.shape[0], GATE_BLOCK):
        if tuning.range_gate and all_outside(columns, first, x, y, variance, bound):
            continue
        for index in range(first, min(first + GATE_BLOCK, candidates.shape[0])):
            if tuning.range_gate:
                dx, dy = candidates[index, 0] - x, candidates[index, 1] - y
                if dx * dx + dy * dy > bound * (variance + candidates[index, 2] + candidates[index, 4]):
                    continue
            moments = moments_of(pose, covariance, root, mount, candidates[index], sighting, tuning)
            evaluated += 1
            distance = squared_distance(moments, sighting)
            if not distance < math.inf:
                continue
            log = log_likelihood(moments, distance)
            least = min(least, distance)
            if log > likeliest_log:
                likeliest, likeliest_log = index, log
            if not used[index] and log > free_log:
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
    pose: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    candidates: FloatArray,
    features: FloatArray,
    order: IntArray,
    tuning: Tuning,
    chosen: IntArray,
) -> tuple[float, int]:
    """Fill chosen (K,) with candidate indices or verdicts; pose and covariance follow match by match, in place.

    When another open feature fits the landmark better than the one at hand, that one goes first: the best keeps it.
    Returns the log weight of this particle's step and the number of likelihoods.
    """
    used = np.zeros(candidates.shape[0], dtype=np.bool_)
    columns = gate_columns(candidates)
    widest = max(tuning.match_widest_square, tuning.create_square) if tuning.density else tuning.match_fixed_square
    log_weight, evaluated = 0.0, 0
    chosen[:] = PENDING
    root = np.empty((3, 3))
    pose_root_into(covariance, root)
    largest_rr = 0.0
    for feature in range(order.size):
        largest_rr = max(largest_rr, features[feature, 2])
    for position in range(order.size):
        feature = order[position]
        while chosen[feature] == PENDING:
            sighting = sighting_of(features, feature)
            free, distance, moments, likeliest, least, looked = best_landmark(
                pose,
                covariance,
                root,
                mount,
                candidates,
                columns,
                used,
                sighting,
                (features[feature, 6], features[feature, 7]),
                tuning,
                widest,
            )
            evaluated += looked
            if free < 0 or not accepts(distance, candidates, free, tuning):
                excluded = likeliest >= 0 and used[likeliest] and accepts(least, candidates, likeliest, tuning)
                chosen[feature] = verdict_without_match(features[feature, 5] > 0.0, least, excluded, tuning)
                log_weight += tuning.log_unmatched
                break
            taker = feature
            for later in range(position + 1, order.size):
                rival = order[later]
                gap = abs(features[rival, 0] - features[feature, 0])
                if gap * gap >= widest * 4.0 * (sighting.rr + largest_rr) + 1.0:
                    break  # the others are farther still
                if chosen[rival] == PENDING and gap * gap < widest * 4.0 * (sighting.rr + features[rival, 2]) + 1.0:
                    claim = sighting_of(features, rival)
                    rival_distance = squared_distance(with_noise(moments, sighting, claim), claim)
                    if rival_distance < distance:
                        taker, distance = rival, rival_distance
            winner = sighting_of(features, taker)
            moments = with_noise(moments, sighting, winner)
            log_weight += log_likelihood(moments, squared_distance(moments, winner))
            fold_in(pose, covariance, moments, winner)
            pose_root_into(covariance, root)
            chosen[taker] = free
            used[free] = True
    return log_weight, evaluated


@kernel
def fold_all(
    pose: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    candidates: FloatArray,
    features: FloatArray,
    order: IntArray,
    tuning: Tuning,
    chosen: IntArray,
) -> float:
    """Fold matches that are already decided into the pose, new sigma points for each; returns the log weight."""
    log_weight = 0.0
    root = np.empty((3, 3))
    for position in range(order.size):
        feature = order[position]
        if chosen[feature] < 0:
            log_weight += tuning.log_unmatched if chosen[feature] != OUT_OF_RANGE else 0.0
            continue
        sighting = sighting_of(features, feature)
        pose_root_into(covariance, root)
        moments = moments_of(pose, covariance, root, mount, candidates[chosen[feature]], sighting, tuning)
        distance = squared_distance(moments, sighting)
        if distance < math.inf:
            log_weight += log_likelihood(moments, distance)
            fold_in(pose, covariance, moments, sighting)
    return log_weight


@kernel
def associate_simultaneously(
    pose: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    candidates: FloatArray,
    features: FloatArray,
    tuning: Tuning,
    chosen: IntArray,
) -> int:
    """The printed form of (4): every feature takes its likeliest landmark as seen from the predicted pose.

    With exclusivity the likeliest claim keeps a landmark and the other features count as new. Fills chosen (K,),
    returns the number of likelihoods.
    """
    count = features.shape[0]
    used = np.zeros(candidates.shape[0], dtype=np.bool_)
    columns = gate_columns(candidates)
    distances = np.empty(count)
    widest = max(tuning.match_widest_square, tuning.create_square) if tuning.density else tuning.match_fixed_square
    root = np.empty((3, 3))
    pose_root_into(covariance, root)
    evaluated = 0
    for feature in range(count):
        free, distance, _, _, least, looked = best_landmark(
            pose,
            covariance,
            root,
            mount,
            candidates,
            columns,
            used,
            sighting_of(features, feature),
            (features[feature, 6], features[feature, 7]),
            tuning,
            widest,
        )
        evaluated += looked
        distances[feature] = distance
        if free >= 0 and accepts(distance, candidates, free, tuning):
            chosen[feature] = free
        else:
            chosen[feature] = verdict_without_match(features[feature, 5] > 0.0, least, False, tuning)
    if tuning.exclusivity:
        for feature in range(count):
            for rival in range(count):
                if rival != feature and chosen[feature] >= 0 and chosen[rival] == chosen[feature]:
                    loser = rival if distances[feature] <= distances[rival] else feature
                    chosen[loser] = verdict_without_match(features[loser, 5] > 0.0, distances[loser], True, tuning)
    return evaluated


@kernel
def associate_by_identity(
    pose: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    candidates: FloatArray,
    identities: IntArray,
    features: FloatArray,
    feature_identities: IntArray,
    tuning: Tuning,
    chosen: IntArray,
) -> int:
    """Match equal identities inside a wide gate; a feature without identity is left alone. Returns the likelihoods."""
    root = np.empty((3, 3))
    pose_root_into(covariance, root)
    evaluated = 0
    for feature in range(features.shape[0]):
        chosen[feature] = NEW if feature_identities[feature] >= 0 else UNLICENSED
        for index in range(candidates.shape[0]):
            if feature_identities[feature] >= 0 and identities[index] == feature_identities[feature]:
                sighting = sighting_of(features, feature)
                moments = moments_of(pose, covariance, root, mount, candidates[index], sighting, tuning)
                evaluated += 1
                matches = squared_distance(moments, sighting) <= tuning.match_known_square
                chosen[feature] = index if matches else AMBIGUOUS
    return evaluated
