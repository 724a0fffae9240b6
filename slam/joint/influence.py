"""How far one matched feature moves the pose against the word of all others of its scan."""

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.functions import hypotenuse
from slam.compiled import kernel, leaf
from slam.joint.kernels import innovate
from slam.joint.measurement import JointArrays
from slam.observations import FeatureRows

METRES_PER_RAD = 1.0


@kernel
def influences(joint: JointArrays, places: IntArray, matched: IntArray, features: FeatureRows) -> FloatArray:
    """(k,) m between the pose that all pairs make and the one that all but this pair make; a radian counts as a metre.

    places (k,) of the landmarks, matched (k,) numbers of their features. From the innovations of all together (Cook
    and Weisberg 1982): with M the inverse of their covariance, leaving out the pair i takes back
    (H P)^T M_i (M_ii)^-1 (M gap)_i.
    """
    k = places.size
    projected, gap, inverse = np.empty((2 * k, joint.size)), np.empty(2 * k), np.zeros((2 * k, 2 * k))
    innovate(joint, joint.mean, places, matched, features, projected, gap, inverse)
    for row in range(2 * k):
        for column in range(row):
            inverse[column, row] = inverse[row, column]
    invert(inverse)
    found = np.empty(k)
    for pair in range(k):
        first, second = 2 * pair, 2 * pair + 1
        a, b, c = inverse[first, first], inverse[first, second], inverse[second, second]
        u, v = 0.0, 0.0
        for column in range(2 * k):
            u += inverse[first, column] * gap[column]
            v += inverse[second, column] * gap[column]
        determinant = max(a * c - b * b, 1e-300)
        u, v = (c * u - b * v) / determinant, (a * v - b * u) / determinant
        moved = np.zeros(3)
        for row in range(2 * k):
            moved += projected[row, :3] * (inverse[row, first] * u + inverse[row, second] * v)
        found[pair] = hypotenuse(moved[0], moved[1]) + METRES_PER_RAD * abs(moved[2])
    return found


@leaf
def invert(matrix: FloatArray) -> None:
    """Invert a positive definite matrix (m, m) in place (Gauss and Jordan)."""
    size = matrix.shape[0]
    for pivot in range(size):
        scale = 1.0 / max(matrix[pivot, pivot], 1e-15)
        matrix[pivot, pivot] = 1.0
        for column in range(size):
            matrix[pivot, column] *= scale
        for row in range(size):
            factor = matrix[row, pivot]
            if row != pivot and factor != 0.0:
                matrix[row, pivot] = 0.0
                for column in range(size):
                    matrix[row, column] -= factor * matrix[pivot, column]
