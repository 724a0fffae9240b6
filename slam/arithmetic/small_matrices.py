"""Products, inverses and eigenvectors of small matrices, summed in written order whatever the processor.

A BLAS has other code for every processor, which adds in another order.
"""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.compiled import kernel, leaf

SWEEPS = 30  # of Jacobi's method, at most; three by three settle in six


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """(n, m) times (m, k)."""
    result = np.zeros((first.shape[0], second.shape[1]))
    _multiply(np.ascontiguousarray(first), np.ascontiguousarray(second), result)
    return result


def applied(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """(n, m) times (m,)."""
    return product(matrix, vector[:, np.newaxis])[:, 0]


def inner(first: FloatArray, second: FloatArray) -> float:
    """Sum of the products of two vectors (n,)."""
    return float((first * second).sum())


def carried(by: FloatArray, covariance: FloatArray) -> FloatArray:
    """A covariance (m, m) carried by derivatives (n, m): (n, n)."""
    result = np.zeros((by.shape[0], by.shape[0]))
    _carry(np.ascontiguousarray(by), np.ascontiguousarray(covariance), result)
    return result


def inverse(matrix: FloatArray) -> FloatArray:
    """Of (n, n). Raises LinAlgError where it has none."""
    work, result = np.array(matrix, dtype=np.float64), np.eye(len(matrix))
    if not eliminate(work, result):
        raise np.linalg.LinAlgError(f"a matrix of {len(matrix)} rows is singular: expected one with an inverse")
    return result


def squared_distance(off: FloatArray, covariance: FloatArray) -> float:
    """off^T covariance^-1 off (Mahalanobis), of (n,) and (n, n). Raises LinAlgError."""
    work, right = np.array(covariance, dtype=np.float64), np.array(off, dtype=np.float64)[:, np.newaxis]
    if not eliminate(work, right):
        raise np.linalg.LinAlgError(f"a covariance of {len(off)} rows is singular: expected one with an inverse")
    return inner(off, right[:, 0])


def eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (n,), the smallest first, and vectors (n, n), one a column, of a symmetric matrix (n, n); NaN where a part
    of it is no finite number.
    """
    if not np.isfinite(matrix).all():
        return np.full(len(matrix), math.nan), np.full(matrix.shape, math.nan)
    work, vectors = np.array(matrix, dtype=np.float64), np.eye(len(matrix))
    _rotate_to_diagonal(work, vectors)
    values = np.diag(work)
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


def bounded_below(matrix: FloatArray, least: float) -> FloatArray:
    """The symmetric matrix (n, n) with eigenvalues below `least` raised to it."""
    values, vectors = eigen(matrix)
    bounded = product(vectors * np.maximum(values, least), vectors.T)
    return 0.5 * (bounded + bounded.T)


def pseudo_inverse(matrix: FloatArray, least_share: float = 1e-13) -> FloatArray:
    """Of a symmetric positive matrix (n, n): directions with less than this share of the largest are left out."""
    values, vectors = eigen(matrix)
    kept = values > least_share * values.max(initial=0.0)
    shares = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return product(vectors * shares, vectors.T)


@kernel
def eliminate(matrix: FloatArray, right: FloatArray) -> bool:
    """right (n, k) becomes matrix^-1 right, by Gauss and Jordan with pivots; False where there is no inverse.

    matrix (n, n) is overwritten.
    """
    n, columns = matrix.shape[0], right.shape[1]
    for step in range(n):
        pivot = step
        for row in range(step + 1, n):
            if abs(matrix[row, step]) > abs(matrix[pivot, step]):
                pivot = row
        if matrix[pivot, step] == 0.0:
            return False
        if pivot != step:
            for column in range(n):
                matrix[step, column], matrix[pivot, column] = matrix[pivot, column], matrix[step, column]
            for column in range(columns):
                right[step, column], right[pivot, column] = right[pivot, column], right[step, column]
        scale = 1.0 / matrix[step, step]
        for column in range(step + 1, n):
            matrix[step, column] *= scale
        for column in range(columns):
            right[step, column] *= scale
        for row in range(n):
            factor = matrix[row, step]
            if row == step or factor == 0.0:
                continue
            for column in range(step + 1, n):
                matrix[row, column] -= factor * matrix[step, column]
            for column in range(columns):
                right[row, column] -= factor * right[step, column]
    return True


@leaf
def determinant_of_three(m: FloatArray) -> float:
    """Of (3, 3)."""
    value: float = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )
    return value


@leaf
def _multiply(first: FloatArray, second: FloatArray, result: FloatArray) -> None:
    """Line by line, so that many columns are added at once; rows of derivatives are mostly zeros."""
    for row in range(first.shape[0]):
        for index in range(first.shape[1]):
            factor = first[row, index]
            if factor != 0.0:
                for column in range(second.shape[1]):
                    result[row, column] += factor * second[index, column]


@kernel
def _carry(by: FloatArray, covariance: FloatArray, result: FloatArray) -> None:
    half = np.zeros(by.shape)
    _multiply(by, covariance, half)
    for row in range(by.shape[0]):
        for column in range(by.shape[0]):
            for index in range(by.shape[1]):
                if by[column, index] != 0.0:
                    result[row, column] += half[row, index] * by[column, index]


@leaf
def _rotate_to_diagonal(matrix: FloatArray, vectors: FloatArray) -> None:
    """Jacobi's method on a symmetric matrix (n, n), whose rotations vectors (n, n) collect."""
    n = matrix.shape[0]
    for _ in range(SWEEPS):
        settled = True
        for p in range(n):
            for q in range(p + 1, n):
                if abs(matrix[p, q]) <= 1e-17 * math.sqrt(abs(matrix[p, p] * matrix[q, q])) or matrix[p, q] == 0.0:
                    continue
                settled = False
                theta = 0.5 * (matrix[q, q] - matrix[p, p]) / matrix[p, q]
                tangent = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                tangent = -tangent if theta < 0.0 else tangent
                cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for row in range(n):
                    one, other = matrix[row, p], matrix[row, q]
                    matrix[row, p], matrix[row, q] = cosine * one - sine * other, sine * one + cosine * other
                for column in range(n):
                    one, other = matrix[p, column], matrix[q, column]
                    matrix[p, column], matrix[q, column] = cosine * one - sine * other, sine * one + cosine * other
                matrix[p, q] = matrix[q, p] = 0.0
                for row in range(n):
                    one, other = vectors[row, p], vectors[row, q]
                    vectors[row, p], vectors[row, q] = cosine * one - sine * other, sine * one + cosine * other
        if settled:
            return
