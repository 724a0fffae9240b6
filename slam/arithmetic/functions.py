"""The elementary functions compiled, for kernels and over whole arrays, and normal numbers drawn with them."""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic import elementary
from slam.compiled import leaf

arctangent = leaf(elementary.arctangent)
cosine_sine = leaf(elementary.cosine_sine)
exponential = leaf(elementary.exponential)
hypotenuse = leaf(elementary.hypotenuse)
logarithm = leaf(elementary.logarithm)


def cosines_sines(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cosines and sines, each in the shape of the angles."""
    flat = np.ascontiguousarray(angles, dtype=np.float64).reshape(-1)
    cosines, sines = np.empty(flat.size), np.empty(flat.size)
    _cosines_sines(flat, cosines, sines)
    return cosines.reshape(np.shape(angles)), sines.reshape(np.shape(angles))


def arctangents(y: FloatArray, x: FloatArray) -> FloatArray:
    """(n,) angles of the vectors (x, y)."""
    angles = np.empty(len(x))
    _arctangents(np.ascontiguousarray(y), np.ascontiguousarray(x), angles)
    return angles


def exponentials(values: FloatArray) -> FloatArray:
    """e to the power of each of (n,)."""
    powers = np.empty(len(values))
    _exponentials(np.ascontiguousarray(values), powers)
    return powers


def lengths(vectors: FloatArray) -> FloatArray:
    """(...) lengths of vectors (..., 2)."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def composed(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Row by row a_from_b @ b_from_c of poses (n, 3) or (3,), as slam.pose.composed; headings are not wrapped."""
    cosines, sines = cosines_sines(outer[..., 2])
    x, y = inner[..., 0], inner[..., 1]
    moved = outer[..., 0] + cosines * x - sines * y, outer[..., 1] + sines * x + cosines * y
    return np.stack(np.broadcast_arrays(*moved, outer[..., 2] + inner[..., 2]), axis=-1)


def normals(generator: np.random.Generator, count: int) -> FloatArray:
    """(count, 3) standard normal numbers (Box and Muller 1958); numpy's own ask the C library in the tails."""
    uniform = generator.random((2, (3 * count + 1) // 2))
    drawn = np.empty(2 * uniform.shape[1])
    _normals(uniform, drawn)
    return drawn[: 3 * count].reshape(count, 3)


@leaf
def _cosines_sines(angles: FloatArray, cosines: FloatArray, sines: FloatArray) -> None:
    for index in range(angles.size):
        cosines[index], sines[index] = cosine_sine(angles[index])


@leaf
def _arctangents(y: FloatArray, x: FloatArray, angles: FloatArray) -> None:
    for index in range(x.size):
        angles[index] = arctangent(y[index], x[index])


@leaf
def _exponentials(values: FloatArray, powers: FloatArray) -> None:
    for index in range(values.size):
        powers[index] = exponential(values[index])


@leaf
def _normals(uniform: FloatArray, drawn: FloatArray) -> None:
    for index in range(uniform.shape[1]):
        cosine, sine = cosine_sine(2.0 * math.pi * uniform[0, index])
        radius = math.sqrt(-2.0 * logarithm(1.0 - uniform[1, index]))
        drawn[2 * index], drawn[2 * index + 1] = radius * cosine, radius * sine
