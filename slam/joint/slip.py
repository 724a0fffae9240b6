"""Association when the wheels may have slipped: the error that all landmarks share is found before any is given up.

Three deviations of one increment happen once in some hundred scans. Every landmark is then outside its gate, a chance
feature is inside one, and a filter that believes it has lost its heading.
"""

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.joint.association import AMBIGUOUS, Gates, associate, nearest_old, presume
from slam.joint.neighbours import block, neighbour_distances

LEAST_AGREEING = 4  # old landmarks that a presumed slip must explain
SLIPS_PRESUMED = 8  # at most, in one scan
BELIEVED = 4  # at least one in so many of the features that look like an old landmark


def associate_with_slip(
    mean: FloatArray,
    covariance: FloatArray,
    size: int,
    mount: FloatArray,
    places: IntArray,
    old: BoolArray,
    rows: FloatArray,
    gates: Gates,
    slip_square: float,
) -> IntArray:
    """Numbers of the landmarks among places (k,), or verdicts, of the features rows (K, 6).

    mean, covariance: the predicted joint state, of which `size` entries are in use. old (k,): landmarks that have
    stood for long; features that may be theirs are looked at first, nearest first, so that no walker moves the pose
    before they do. Where most of what lies within slip_square of an old landmark finds none, each of the likeliest
    pairs is presumed in turn, and the one with which most old landmarks are found is kept. Where that is still few,
    they match by chance, as with a blinded laser or a kidnapped rover: then nothing is believed.
    """
    apart = neighbour_distances(mean, size, places)
    best, squares = np.empty(len(rows), dtype=np.int64), np.empty(len(rows))
    nearest_old(mean, covariance, mount, places, old, rows, slip_square, best, squares)
    order = np.lexsort((rows[:, 0], squares > gates.match_widest))
    chosen = np.empty(len(rows), dtype=np.int64)
    associate(*block(mean, covariance, places), mount, apart, rows, order, gates, chosen)
    likely, agreeing = int((best >= 0).sum()), _old_ones(chosen, old)
    if 2 * agreeing >= likely or likely < LEAST_AGREEING:
        return chosen
    least = max(LEAST_AGREEING, agreeing + 1, (likely + 1) // 2)
    for seed in np.argsort(squares, kind="stable")[: min(likely, SLIPS_PRESUMED)].tolist():
        part_mean, part_covariance = block(mean, covariance, places)
        presume(part_mean, part_covariance, mount, int(best[seed]), rows[seed])
        trial = np.empty_like(chosen)
        associate(part_mean, part_covariance, mount, apart, rows, order, gates, trial)
        if _old_ones(trial, old) >= least:
            chosen, least = trial, _old_ones(trial, old) + 1
    if BELIEVED * _old_ones(chosen, old) < likely:
        chosen[chosen >= 0] = AMBIGUOUS
    return chosen


def _old_ones(chosen: IntArray, old: BoolArray) -> int:
    return int(old[chosen[chosen >= 0]].sum())
