"""Association when the wheels may have slipped: the error that all landmarks share is found before any is given up.

Three deviations of one increment happen once in some hundred scans. Every landmark is then outside its gate, a chance
feature is inside one, and a filter that believes it has lost its heading.
"""

import numpy as np

from drivers.measurements import BoolArray, IntArray
from slam.joint.association import Gates, apply_hypothesis, associate, expected_within, lie_near, nearest_old
from slam.joint.measurement import JointArrays
from slam.joint.neighbours import block, neighbour_distances
from slam.observations import AMBIGUOUS, FeatureRows
from slam.visibility import sighting_of

LEAST_AGREEING = 4  # old landmarks that a hypothetical slip must explain
MOST_HYPOTHESES = 8  # at most, in one scan
APART_M = 0.5  # sigma of where a landmark should be seen; door frames stand a metre apart
ALONE_M = 0.1  # the same, from which on one landmark is not believed alone
BELIEVED = 4  # at least one in so many of the features that look like an old landmark


def associate_with_slip(
    joint: JointArrays,
    places: IntArray,
    others: IntArray,
    old: BoolArray,
    asks_for_two: bool,
    features: FeatureRows,
    gates: Gates,
) -> IntArray:
    """Numbers of the landmarks among places (k,), or verdicts, of the features as seen from the predicted pose.

    others (l,): places of all landmarks of the state. old (k,): landmarks that have stood for long; features that may
    be theirs are looked at first, nearest first, so that no walker moves the pose before they do. asks_for_two:
    the scan was laid onto others, so that no landmark need be found: one that may be seen anywhere between its
    neighbours is not, and one that would move the pose far is only with a second one.

    Where most of what lies within gates.slip of an old landmark finds none, each of the likeliest pairs is taken for
    true in turn, and the one with which most old landmarks are found is kept. Where that is still few, they match by
    chance, as with a blinded laser or a kidnapped rover: then nothing is believed.
    """
    mean, covariance, _, mount = joint
    apart = neighbour_distances(mean, places, others)
    sigma_m = expected_within(joint, places)
    barred, alone = asks_for_two & (sigma_m > APART_M), asks_for_two & (sigma_m > ALONE_M)
    best, squares = nearest_old(joint, places, old, features, gates.slip)
    features = features._replace(order=np.lexsort((features.ranges_m, squares > gates.match_widest)))
    chosen = np.empty_like(best)
    associate(*block(mean, covariance, places), mount, apart, features, gates, barred, chosen)
    if alone[chosen[chosen >= 0]].sum() == 1:
        associate(*block(mean, covariance, places), mount, apart, features, gates, alone, chosen)
    likely, agreeing = int((best >= 0).sum()), _old_ones(chosen, old)
    if 2 * agreeing >= likely or likely < LEAST_AGREEING:
        return chosen
    least = max(LEAST_AGREEING, agreeing + 1, (likely + 1) // 2)
    for seed in np.argsort(squares, kind="stable")[: min(likely, MOST_HYPOTHESES)].tolist():
        part_mean, part_covariance = block(mean, covariance, places)
        apply_hypothesis(part_mean, part_covariance, mount, int(best[seed]), sighting_of(features, seed))
        trial = np.empty_like(chosen)
        associate(part_mean, part_covariance, mount, apart, features, gates, barred, trial)
        if _old_ones(trial, old) >= least:
            chosen, least = trial, _old_ones(trial, old) + 1
    if BELIEVED * _old_ones(chosen, old) < likely:
        chosen[chosen >= 0] = AMBIGUOUS
    return chosen


def undecided(
    joint: JointArrays, places: IntArray, asks_for_two: bool, features: FeatureRows, gates: Gates
) -> BoolArray:
    """(k,) which landmarks at places (k,) may be matched only with others, but have a feature where they may be: where
    they are not found, they are not missed either.
    """
    if not asks_for_two:
        return np.zeros(len(places), dtype=np.bool_)
    unsure: BoolArray = expected_within(joint, places) > ALONE_M
    unsure[unsure] = lie_near(joint, places[unsure], features, gates.match_widest)
    return unsure


def _old_ones(chosen: IntArray, old: BoolArray) -> int:
    return int(old[chosen[chosen >= 0]].sum())
