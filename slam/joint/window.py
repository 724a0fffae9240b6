"""The window: landmarks leave the joint state as a regression on neighbours that stay, and come back by it.

A landmark that leaves is written as m + W (s - s_0) + e, with s its nearest neighbours in the state and e independent
noise: exact for the pair of it and them, and all else that is known of it runs through them.
"""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import kernel, leaf
from slam.joint.measurement import FIRST_PLACE

JITTER = 1e-12
ORPHAN = -1


@kernel
def regress(covariance: FloatArray, at: int, others: IntArray, weights: FloatArray, residual: FloatArray) -> None:
    """weights (2, 2 k) and residual covariance (2, 2) of the landmark at `at` given those at others (k,)."""
    k = 2 * others.size
    root, right = np.empty((k, k)), np.empty((2, k))
    for row in range(k):
        place = others[row // 2] + row % 2
        right[0, row], right[1, row] = covariance[at, place], covariance[at + 1, place]
        for column in range(row + 1):
            total = covariance[place, others[column // 2] + column % 2]
            if row == column:
                total += JITTER + 1e-9 * total
            for inner in range(column):
                total -= root[row, inner] * root[column, inner]
            root[row, column] = math.sqrt(max(total, JITTER)) if row == column else total / root[column, column]
    for axis in range(2):
        solution = weights[axis]
        for row in range(k):
            total = right[axis, row]
            for inner in range(row):
                total -= root[row, inner] * solution[inner]
            solution[row] = total / root[row, row]
    for row in range(2):
        for column in range(2):
            total = covariance[at + row, at + column]
            for inner in range(k):
                total -= weights[row, inner] * weights[column, inner]
            residual[row, column] = total
    residual[0, 0] = max(residual[0, 0], JITTER)
    residual[1, 1] = max(residual[1, 1], JITTER)
    bound = 0.999999 * math.sqrt(residual[0, 0] * residual[1, 1])
    residual[0, 1] = min(max(residual[0, 1], -bound), bound)
    residual[1, 0] = residual[0, 1]
    for axis in range(2):
        solution = weights[axis]
        for row in range(k - 1, -1, -1):
            total = solution[row]
            for inner in range(row + 1, k):
                total -= root[inner, row] * solution[inner]
            solution[row] = total / root[row, row]


@leaf
def restore(covariance: FloatArray, n: int, others: IntArray, weights: FloatArray, residual: FloatArray) -> None:
    """Rows and columns n, n + 1 of a landmark that comes back, from the landmarks at others (k,) that it hangs on."""
    for column in range(n):
        for axis in range(2):
            total = 0.0
            for index in range(2 * others.size):
                total += weights[axis, index] * covariance[others[index // 2] + index % 2, column]
            covariance[n + axis, column] = total
            covariance[column, n + axis] = total
    for row in range(2):
        for column in range(row + 1):
            total = residual[row, column]
            for index in range(2 * others.size):
                total += weights[row, index] * covariance[others[index // 2] + index % 2, n + column]
            covariance[n + row, n + column] = total
            covariance[n + column, n + row] = total


@leaf
def least_needed(mean: FloatArray, n: int, eligible: BoolArray) -> int:
    """The eligible landmark (L,) whose neighbour is nearest as seen from the rover; -1 if none is.

    So the kept ones thin out with distance: every direction and scale keeps a few.
    """
    best, best_score = -1, math.inf
    landmarks = (n - FIRST_PLACE) // 2
    for landmark in range(landmarks):
        if not eligible[landmark]:
            continue
        at = FIRST_PLACE + 2 * landmark
        x, y = mean[at], mean[at + 1]
        nearest = math.inf
        for other in range(landmarks):
            if other != landmark:
                dx, dy = mean[FIRST_PLACE + 2 * other] - x, mean[FIRST_PLACE + 1 + 2 * other] - y
                nearest = min(nearest, dx * dx + dy * dy)
        score = nearest / ((x - mean[0]) * (x - mean[0]) + (y - mean[1]) * (y - mean[1]))
        if score < best_score:
            best, best_score = landmark, score
    return best


@kernel
def nearest_places(mean: FloatArray, n: int, at: int, count: int) -> IntArray:
    """Places of the landmarks nearest to the one at `at`, at most count, nearest first."""
    landmarks = (n - FIRST_PLACE) // 2
    squares = np.full(landmarks, math.inf)
    for landmark in range(landmarks):
        place = FIRST_PLACE + 2 * landmark
        if place != at:
            dx, dy = mean[place] - mean[at], mean[place + 1] - mean[at + 1]
            squares[landmark] = dx * dx + dy * dy
    found = np.empty(min(count, landmarks - 1), dtype=np.int64)
    for index in range(found.size):
        nearest = int(np.argmin(squares))
        found[index] = FIRST_PLACE + 2 * nearest
        squares[nearest] = math.inf
    return found


@kernel
def ancestors_first(rows: IntArray, away: BoolArray, parents: IntArray) -> IntArray:
    """Rows (r,) with all that they hang on outside the state, each once, every landmark after its parents (R, 4)."""
    stack, ordered = np.empty(away.size + 1, dtype=np.int64), np.empty(away.size, dtype=np.int64)
    waits = away.copy()
    found = 0
    for start in rows:
        depth = 1
        stack[0] = start
        while depth > 0:
            row = stack[depth - 1]
            above = -1
            for parent in parents[row]:
                if waits[row] and above < 0 and parent >= 0 and waits[parent]:
                    above = parent
            if above >= 0:
                stack[depth] = above
                depth += 1
                continue
            depth -= 1
            if waits[row]:
                waits[row] = False
                ordered[found] = row
                found += 1
    return ordered[:found]


@kernel
def settle(
    rows: IntArray,
    known: BoolArray,
    means: FloatArray,
    parents: IntArray,
    parent_means: FloatArray,
    weights: FloatArray,
) -> None:
    """Bring the means (R, 2) of rows (f,) that are outside the state up to date with those that they hang on.

    known (R,) is True for rows whose means are right already, and becomes True for all others.
    """
    stack = np.empty(known.size + 1, dtype=np.int64)
    for start in rows:
        depth = 1
        stack[0] = start
        while depth > 0:
            row = stack[depth - 1]
            waiting = -1
            for parent in parents[row]:
                if not known[row] and parent >= 0 and not known[parent]:
                    waiting = parent
            if waiting >= 0:
                stack[depth] = waiting
                depth += 1
                continue
            depth -= 1
            if known[row]:
                continue
            known[row] = True
            if parents[row, 0] == ORPHAN:
                continue
            for index in range(parents.shape[1]):
                parent = parents[row, index]
                if parent >= 0:
                    for axis in range(2):
                        moved = means[parent, axis] - parent_means[row, 2 * index + axis]
                        for out in range(2):
                            means[row, out] += weights[row, out, 2 * index + axis] * moved
                        parent_means[row, 2 * index + axis] = means[parent, axis]
