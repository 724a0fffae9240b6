"""Association when the wheels may have slipped: the error that all landmarks share is found before any is given up.

Three deviations of one increment happen once in some hundred scans. Every landmark is then outside its gate, a chance
feature is inside one, and a filter that believes it has lost its heading.
"""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.joint.association import Gates, apply_hypothesis, associate, expected_within, lie_near, nearest_old
from slam.joint.influence import influences
from slam.joint.measurement import JointArrays
from slam.joint.neighbours import block, neighbour_distances
from slam.observations import AMBIGUOUS, FeatureRows
from slam.visibility import sighting_of

LEAST_AGREEING = 4  # old landmarks that a hypothetical slip must explain
MOST_HYPOTHESES = 8  # at most, in one scan
APART_M = 0.5  # sigma of where a landmark should be seen; door frames stand a metre apart
WIDE_M = 0.1  # the same, from which on it is asked how far a landmark moves the pose
AGAINST_M = 0.1  # by which such a one may not move the pose against the word of all others
BELIEVED = 4  # at least one in so many of the features that look like an old landmark


def associate_with_slip(
    joint: JointArrays,
    places: IntArray,
    others: IntArray,
    old: BoolArray,
    alone_m: float,
    features: FeatureRows,
    gates: Gates,
) -> IntArray:
    """Numbers of the landmarks among places (k,), or verdicts, of the features as seen from the predicted pose.

    others (l,): places of all landmarks of the state. old (k,): landmarks that have stood for long; features that may
    be theirs are looked at first, nearest first, so that no walker moves the pose before they do. alone_m: the sigma of
    where a landmark should be seen above which it is not believed alone; inf where every landmark is needed, and is
    believed against the word of the others, too.

    Where most of what lies within gates.slip of an old landmark finds none, each of the likeliest pairs is taken for
    true in turn, and the one with which most old landmarks are found is kept. Where that is still few, they match by
    chance, as with a blinded laser or a kidnapped rover: then nothing is believed.
    """
    apart = neighbour_distances(joint.mean, places, others)
    sigma_m, asks = expected_within(joint, places), math.isfinite(alone_m)
    best, squares = nearest_old(joint, places, old, features, gates.slip)
    features = features._replace(order=np.lexsort((features.ranges_m, squares > gates.match_widest)))

    def found(seed: int | None = None) -> IntArray:
        """What is found, as if the feature `seed` were the old landmark that is nearest to it."""
        barred = asks & (sigma_m > APART_M)
        while True:
            mean, covariance = block(joint.mean, joint.covariance, places)
            if seed is not None:
                apply_hypothesis(mean, covariance, joint.mount, int(best[seed]), sighting_of(features, seed))
            chosen = np.empty_like(best)
            associate(mean, covariance, joint.mount, apart, features, gates, barred, chosen)
            alone = _alone(joint, places, sigma_m, alone_m, features, chosen) if asks else None
            if alone is None:
                return chosen
            barred[alone] = True

    chosen = found()
    likely, agreeing = int((best >= 0).sum()), _old_ones(chosen, old)
    if 2 * agreeing >= likely or likely < LEAST_AGREEING:
        return chosen
    least = max(LEAST_AGREEING, agreeing + 1, (likely + 1) // 2)
    for seed in np.argsort(squares, kind="stable")[: min(likely, MOST_HYPOTHESES)].tolist():
        trial = found(seed)
        if _old_ones(trial, old) >= least:
            chosen, least = trial, _old_ones(trial, old) + 1
    if BELIEVED * _old_ones(chosen, old) < likely:
        chosen[chosen >= 0] = AMBIGUOUS
    return chosen


def undecided(joint: JointArrays, places: IntArray, alone_m: float, features: FeatureRows, gates: Gates) -> BoolArray:
    """(k,) which landmarks at places (k,) may be matched only with others, but have a feature where they may be, or may
    not be matched at all: where they are not found, they are not missed either.
    """
    if not math.isfinite(alone_m):
        return np.zeros(len(places), dtype=np.bool_)
    sigma_m = expected_within(joint, places)
    unsure: BoolArray = sigma_m > WIDE_M
    unsure[unsure] = lie_near(joint, places[unsure], features, gates.match_widest)
    return unsure | (sigma_m > APART_M)


def _alone(
    joint: JointArrays, places: IntArray, sigma_m: FloatArray, alone_m: float, features: FeatureRows, chosen: IntArray
) -> int | None:
    """Which of the landmarks found that may be anywhere moves the pose farthest with no other that says so; None where
    none does. sigma_m (k,) of where each should be seen.
    """
    matched = np.flatnonzero(chosen >= 0)
    found = chosen[matched]
    if len(found) == 1:
        return int(found[0]) if sigma_m[found[0]] > alone_m else None
    wide = sigma_m[found] > WIDE_M
    if not wide.any():
        return None
    moved_m = np.where(wide, influences(joint, places[found], matched, features), 0.0)
    farthest = int(moved_m.argmax())
    return int(found[farthest]) if moved_m[farthest] > AGAINST_M else None


def _old_ones(chosen: IntArray, old: BoolArray) -> int:
    return int(old[chosen[chosen >= 0]].sum())
