"""The landmarks around the rover as a joint Gaussian sees them from where it is."""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import lengths
from slam.arithmetic.small_matrices import carried, product
from slam.joint.gaussian import KEYFRAME
from slam.joint.measurement import FIRST_PLACE
from slam.joint.state import JointState
from slam.observations import IDENTITIES_PER_SCAN
from slam.pose import turning
from slam.recognise.attempt import LocalPoints
from slam.recognise.scale import Scale

LEAST_LOG_ODDS = 1.5  # seen twice
MOST_AROUND = 64


def local_points(state: JointState, scale: Scale, since_scan: int = 0) -> LocalPoints:
    """Landmarks of the state that were made from a scan on, in the present body's frame with their joint covariance.

    What is less exact than scale.widest_local_m from here is left out: what was passed long ago has drifted.
    """
    atlas, rows = state.atlas, state.rows
    identities, log_odds = atlas.identities[rows], atlas.log_odds[rows]
    usable: BoolArray = (identities != KEYFRAME) & (log_odds >= LEAST_LOG_ODDS)
    numbers = np.flatnonzero(usable & (identities >= since_scan * IDENTITIES_PER_SCAN))
    x, y, heading = state.mean[:3].tolist()
    turn = turning(-heading)
    points = product(state.points_m[numbers] - (x, y), turn.T)
    places = FIRST_PLACE + 2 * numbers
    chosen = np.concatenate((np.arange(3), np.column_stack((places, places + 1)).ravel()))
    count = len(numbers)
    by = np.zeros((2 * count, 3 + 2 * count))
    for index, (ahead, left) in enumerate(points.tolist()):
        two = slice(2 * index, 2 * index + 2)
        by[two, :2] = -turn
        by[two, 2] = left, -ahead
        by[two, 3 + 2 * index : 5 + 2 * index] = turn
    covariance = carried(by, state.covariance[np.ix_(chosen, chosen)])
    everything = LocalPoints(identities[numbers], points, covariance, log_odds[numbers])
    exact = np.flatnonzero(everything.variances_m2 <= squared(scale.widest_local_m))
    both = np.column_stack((2 * exact, 2 * exact + 1)).ravel()
    return LocalPoints(
        everything.identities[exact], points[exact], covariance[np.ix_(both, both)], everything.log_odds[exact]
    )


def around(state: JointState, radius_m: float) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """The pose and the landmarks (L,) nearest to it, MOST_AROUND at most: mean (3 + 2 L,), covariance, identities,
    log-odds of existence.
    """
    distances = lengths(state.points_m - state.mean[:2])
    real = (state.atlas.identities[state.rows] != KEYFRAME) & (distances < radius_m)
    numbers = np.argsort(np.where(real, distances, math.inf), kind="stable")[: min(int(real.sum()), MOST_AROUND)]
    places = FIRST_PLACE + 2 * numbers
    chosen = np.concatenate((np.arange(3), np.column_stack((places, places + 1)).ravel()))
    rows = state.rows[numbers]
    covariance = state.covariance[np.ix_(chosen, chosen)]
    return state.mean[chosen], covariance, state.atlas.identities[rows], state.atlas.log_odds[rows]
