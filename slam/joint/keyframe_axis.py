"""A pose in the state of the joint Gaussian, held as two points on the axis of the rover as it stood there.

So it leaves the state and comes back as a landmark does. The two points share the pose's whole error: their own is that
of a ruler.
"""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.angles import wrapped
from slam.arithmetic.functions import arctangent, arctangents, cosine_sine, cosines_sines
from slam.arithmetic.small_matrices import applied, eigen, inverse, product
from slam.compiled import kernel
from slam.joint.kernels import apply_change
from slam.joint.measurement import FIRST_PLACE
from slam.observations import Sighting
from slam.pose import wrap_rads

HALF_AXIS_M = 2.0
RULER_M2, RULER_RAD2 = 1e-6, 2.5e-7
AHEAD = Sighting(HALF_AXIS_M, 0.0, RULER_M2, 0.0, RULER_RAD2)
BEHIND = Sighting(HALF_AXIS_M, math.pi, RULER_M2, 0.0, RULER_RAD2)
SMALLEST_SPREAD = 1e-10


def between(mean: FloatArray, ahead_m: FloatArray, behind_m: FloatArray) -> FloatArray:
    """(K, 3) x m, y m, heading rad of the body as seen from axes whose ends stand at ahead_m and behind_m (K, 2)."""
    axis = ahead_m - behind_m
    headings = arctangents(axis[:, 1], axis[:, 0])
    off = mean[:2] - 0.5 * (ahead_m + behind_m)
    cosines, sines = cosines_sines(headings)
    return np.column_stack(
        (
            cosines * off[:, 0] + sines * off[:, 1],
            cosines * off[:, 1] - sines * off[:, 0],
            wrap_rads(mean[2] - headings),
        )
    )


def seen_from(mean: FloatArray, places: IntArray) -> FloatArray:
    """(K, 3) the body as seen from keyframes whose ends are at places (K, 2); inf where one is outside the state."""
    inside = np.flatnonzero((places >= FIRST_PLACE).all(axis=1))
    seen = np.full((len(places), 3), math.inf)
    ahead, behind = (np.column_stack((mean[at], mean[at + 1])) for at in places[inside].T)
    seen[inside] = between(mean, ahead, behind)
    return seen


def poses_of(ends_m: FloatArray) -> FloatArray:
    """(K, 3) map_from_body of axes whose ends (K, 2, 2) stand ahead and behind."""
    axis = ends_m[:, 0] - ends_m[:, 1]
    return np.column_stack((ends_m.mean(axis=1), arctangents(axis[:, 1], axis[:, 0])))


@kernel
def between_with_covariance(
    mean: FloatArray, covariance: FloatArray, n: int, ahead: int, behind: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The body (3,) as seen from the axis whose ends stand at places ahead and behind, its covariance (3, 3), and H P
    (3, n).
    """
    axis_x, axis_y = mean[ahead] - mean[behind], mean[ahead + 1] - mean[behind + 1]
    heading = arctangent(axis_y, axis_x)
    cosine, sine = cosine_sine(heading)
    off_x = mean[0] - 0.5 * (mean[ahead] + mean[behind])
    off_y = mean[1] - 0.5 * (mean[ahead + 1] + mean[behind + 1])
    seen = np.array((cosine * off_x + sine * off_y, cosine * off_y - sine * off_x, wrapped(mean[2] - heading)))
    square = axis_x * axis_x + axis_y * axis_y
    turn_x, turn_y = -axis_y / square, axis_x / square  # derivative of the axis's heading by its end ahead
    places = np.array((0, 1, 2, ahead, ahead + 1, behind, behind + 1))
    by = np.zeros((3, 7))
    by[0, 0], by[0, 1], by[1, 0], by[1, 1], by[2, 2] = cosine, sine, -sine, cosine, 1.0
    for row in range(2):
        by_heading = seen[1] if row == 0 else -seen[0]
        for axis in range(2):
            turn = turn_x if axis == 0 else turn_y
            by[row, 3 + axis] = -0.5 * by[row, axis] + by_heading * turn
            by[row, 5 + axis] = -0.5 * by[row, axis] - by_heading * turn
    by[2, 3], by[2, 4], by[2, 5], by[2, 6] = -turn_x, -turn_y, turn_x, turn_y
    projected = np.zeros((3, n))
    for row in range(3):
        for index in range(7):
            for column in range(n):
                projected[row, column] += by[row, index] * covariance[places[index], column]
    spread = np.zeros((3, 3))
    for row in range(3):
        for column in range(3):
            for index in range(7):
                spread[row, column] += projected[row, places[index]] * by[column, index]
    for row in range(3):
        for column in range(row):
            spread[row, column] = spread[column, row] = 0.5 * (spread[row, column] + spread[column, row])
        spread[row, row] += SMALLEST_SPREAD
    return seen, spread, projected


def condition(
    mean: FloatArray,
    covariance: FloatArray,
    n: int,
    ends: IntArray,
    off: FloatArray,
    posterior: FloatArray,
    invariant: bool,
) -> None:
    """Make the body as seen from an axis off (3,) from where it was predicted, with covariance posterior (3, 3).

    Everything else follows as far as it depends on that. ends (2,): places of the axis's ends.
    """
    _, spread, projected = between_with_covariance(mean, covariance, n, int(ends[0]), int(ends[1]))
    gain = product(inverse(spread), projected)
    values, vectors = eigen(spread - posterior)
    learnt = np.zeros((4, n))
    learnt[:3] = product(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T, gain)
    apply_change(mean, covariance, n, applied(gain.T, off), learnt, invariant)
