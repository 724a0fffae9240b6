"""Matrix square roots, from which the sigma points (7) of the unscented transform are made."""

import math

from drivers.measurements import FloatArray
from slam.compiled import leaf


@leaf
def square_root_into(covariance: FloatArray, root: FloatArray) -> None:
    """Write lower triangular L (n, n) with L L^T = covariance; directions without variance get a column of zeros.

    A pivot that rounding made negative counts as zero, so that a semidefinite matrix never fails.
    """
    size = covariance.shape[0]
    for column in range(size):
        pivot = covariance[column, column]
        for inner in range(column):
            pivot -= root[column, inner] * root[column, inner]
        if pivot <= 1e-15 * covariance[column, column] or pivot <= 0.0:
            for row in range(size):
                root[row, column] = 0.0
            continue
        root[column, column] = math.sqrt(pivot)
        for row in range(column):
            root[row, column] = 0.0
        for row in range(column + 1, size):
            value = covariance[row, column]
            for inner in range(column):
                value -= root[row, inner] * root[column, inner]
            root[row, column] = value / root[column, column]


@leaf
def pose_root_into(covariance: FloatArray, root: FloatArray) -> None:
    """The same for (3, 3), written out: it stands between any two matches of a particle. Equal to the last bit."""
    first, second, third = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    root[0, 0] = root[1, 0] = root[2, 0] = root[1, 1] = root[2, 1] = root[2, 2] = 0.0
    root[0, 1] = root[0, 2] = root[1, 2] = 0.0
    if not (first <= 1e-15 * first or first <= 0.0):
        root[0, 0] = math.sqrt(first)
        root[1, 0], root[2, 0] = covariance[1, 0] / root[0, 0], covariance[2, 0] / root[0, 0]
    pivot = second - root[1, 0] * root[1, 0]
    if not (pivot <= 1e-15 * second or pivot <= 0.0):
        root[1, 1] = math.sqrt(pivot)
        root[2, 1] = (covariance[2, 1] - root[2, 0] * root[1, 0]) / root[1, 1]
    pivot = third - root[2, 0] * root[2, 0] - root[2, 1] * root[2, 1]
    if not (pivot <= 1e-15 * third or pivot <= 0.0):
        root[2, 2] = math.sqrt(pivot)
