"""Poses that lay a pair of local points onto a pair of the map, and how well the other points fit there."""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.angles import wrapped
from slam.arithmetic.functions import arctangent, cosine_sine, exponential, hypotenuse, logarithm
from slam.arithmetic.small_matrices import determinant_of_three, eliminate
from slam.compiled import kernel, leaf
from slam.recognise.grid import NONE, is_empty, nearest
from slam.recognise.map_index import IndexedMap
from slam.recognise.prior import Region

DETECTION = 0.7  # probability that a landmark of the local map is in the map at all
GIVE_UP = -4.5  # log-likelihood ratio at which a pose is dropped before all points were looked at
GATE_SIGMAS = 2.5
REFINED_GATE_SIGMAS = 3.0
REFINEMENTS = 5
CONVERGED_M, CONVERGED_RAD = 1e-3, 1e-4
SAME_M, SAME_RAD = 1.5, 0.15  # poses nearer than this are one
TASK, AT = 0, 1
COSTLY_LOOK = 5  # times the work of a look where nothing is
SMALLEST = 1e-9


class Searched(NamedTuple):
    """Local points (n, 2) in the body's frame, variances_m2 (n,) with those of the map, and what of them is tried.

    pairs (t, 2): the local pairs; bounds (t, 2): the map's pairs of their length; orders (t, n - 2): the other points,
    nearest to the pair first. bent_m2: what of the variances is there only because the map is bent. region: which poses
    count.
    """

    points_m: FloatArray
    variances_m2: FloatArray
    pairs: IntArray
    bounds: IntArray
    orders: IntArray
    bent_m2: float
    region: Region


class Candidates(NamedTuple):
    """The best poses so far: poses (c, 3), their log-likelihood ratios (c,), -inf where there is none yet."""

    poses: FloatArray
    ratios: FloatArray


@leaf
def ratio(square: float, variance_m2: float, density: float) -> float:
    """Log-likelihood ratio, against chance, of a point that has a landmark within its gate, 1 / m^2 density."""
    peak = DETECTION / (2.0 * math.pi * variance_m2 * density)
    return logarithm(1.0 - DETECTION + peak * exponential(-0.5 * square / variance_m2))


@leaf
def keep(candidates: Candidates, x: float, y: float, heading: float, value: float) -> None:
    """Enter a pose in place of the same one, or else of the worst, where it is better."""
    worst = 0
    for index in range(candidates.ratios.size):
        if candidates.ratios[index] < candidates.ratios[worst]:
            worst = index
        if candidates.ratios[index] > -math.inf:
            dx, dy = candidates.poses[index, 0] - x, candidates.poses[index, 1] - y
            turned = abs(wrapped(candidates.poses[index, 2] - heading))
            if dx * dx + dy * dy < SAME_M * SAME_M and turned < SAME_RAD:
                worst = index
                break
    if value > candidates.ratios[worst]:
        candidates.poses[worst, 0], candidates.poses[worst, 1], candidates.poses[worst, 2] = x, y, heading
        candidates.ratios[worst] = value


@kernel
def search(searched: Searched, known: IndexedMap, cursor: IntArray, most_looks: int, candidates: Candidates) -> int:
    """Go on from cursor (2,) until so many points were looked up; returns how many. Done when cursor[0] is len(pairs).

    A pose is dropped as soon as its points speak against it: most after four.
    """
    missing = logarithm(1.0 - DETECTION)
    others = searched.orders.shape[1]
    ahead, left = np.empty(others), np.empty(others)
    variances, gates = np.empty(others), np.empty(others)
    places, occupied, per_metre = known.grid.points_m, known.grid.occupied, 1.0 / known.grid.patch_m
    region = searched.region
    ahead_x, ahead_y = cosine_sine(region.heading)
    looks = 0
    while cursor[TASK] < searched.pairs.shape[0]:
        task = cursor[TASK]
        along_x, along_y, middle_x, middle_y = prepare(searched, task, known.grid.cell_m, ahead, left, variances, gates)
        length = math.sqrt(along_x * along_x + along_y * along_y)
        for at in range(cursor[AT], searched.bounds[task, 1]):
            if looks >= most_looks:
                cursor[AT] = at
                return looks
            for turn in range(2):
                i, j = known.pairs.first[at], known.pairs.second[at]
                if turn == 1:
                    i, j = j, i
                to_x, to_y = places[j, 0] - places[i, 0], places[j, 1] - places[i, 1]
                scale = 1.0 / (length * math.sqrt(to_x * to_x + to_y * to_y))
                cosine = scale * (along_x * to_x + along_y * to_y)
                sine = scale * (along_x * to_y - along_y * to_x)
                x = places[i, 0] + 0.5 * to_x - cosine * middle_x + sine * middle_y
                y = places[i, 1] + 0.5 * to_y - sine * middle_x - cosine * middle_y
                is_far = hypotenuse(x - region.x, y - region.y) > region.reach_m
                if is_far or cosine * ahead_x + sine * ahead_y < region.least_cosine:
                    looks += 1
                    continue
                value = 0.0
                for u in range(others):
                    there_x, there_y = x + cosine * ahead[u] - sine * left[u], y + sine * ahead[u] + cosine * left[u]
                    looks += 1
                    found, square = NONE, 0.0
                    if not is_empty(occupied, per_metre, there_x, there_y):
                        looks += COSTLY_LOOK
                        found, square = nearest(known.grid, there_x, there_y, gates[u])
                    value += missing if found == NONE else ratio(square, variances[u], known.densities[found])
                    if value < GIVE_UP:
                        break
                if value >= GIVE_UP:
                    looks += COSTLY_LOOK
                    keep(candidates, x, y, arctangent(sine, cosine), value)
        cursor[TASK] += 1
        if cursor[TASK] < searched.pairs.shape[0]:
            cursor[AT] = searched.bounds[cursor[TASK], 0]
    return looks


@leaf
def prepare(
    searched: Searched,
    task: int,
    widest_m: float,
    ahead: FloatArray,
    left: FloatArray,
    variances: FloatArray,
    gates: FloatArray,
) -> tuple[float, float, float, float]:
    """The other points of a local pair, nearest first, and how far each may be off once the pair lies on another.

    Returns the vector from the pair's first point to its second, and its middle.
    """
    points = searched.points_m
    a, b = searched.pairs[task, 0], searched.pairs[task, 1]
    along_x, along_y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    middle_x, middle_y = 0.5 * (points[a, 0] + points[b, 0]), 0.5 * (points[a, 1] + points[b, 1])
    own = searched.variances_m2[a] + searched.variances_m2[b]
    for index in range(ahead.size):
        u = searched.orders[task, index]
        ahead[index], left[index] = points[u, 0], points[u, 1]
        off_x, off_y = points[u, 0] - middle_x, points[u, 1] - middle_y
        lever = (off_x * off_x + off_y * off_y) / (along_x * along_x + along_y * along_y)
        variances[index] = searched.variances_m2[u] + own * (0.25 + lever)
        gates[index] = min(GATE_SIGMAS * math.sqrt(variances[index]), widest_m)
    return along_x, along_y, middle_x, middle_y


@kernel
def match(
    searched: Searched, known: IndexedMap, pose: FloatArray, sigmas: float, takers: IntArray, matches: IntArray
) -> None:
    """Fill matches (n,) with the map's rows: each landmark goes to the local point nearest to it, NONE elsewhere.

    takers (R,) is NONE everywhere before and afterwards.
    """
    cosine, sine = cosine_sine(pose[2])
    squares = np.empty(matches.size)
    for u in range(matches.size):
        px, py = searched.points_m[u, 0], searched.points_m[u, 1]
        gate = sigmas * math.sqrt(searched.variances_m2[u])
        found, squares[u] = nearest(
            known.grid, pose[0] + cosine * px - sine * py, pose[1] + sine * px + cosine * py, gate
        )
        matches[u] = found
        if found == NONE:
            continue
        taker = takers[found]
        if taker != NONE and squares[taker] <= squares[u]:
            matches[u] = NONE
            continue
        if taker != NONE:
            matches[taker] = NONE
        takers[found] = u
    for u in range(matches.size):
        if matches[u] != NONE:
            takers[matches[u]] = NONE


@kernel
def information_at(
    searched: Searched, known: IndexedMap, pose: FloatArray, matches: IntArray, less_m2: float, information: FloatArray
) -> tuple[float, float, float]:
    """Fill information (3, 3) of the matches about the pose; returns the slope of their squares there.

    less_m2: by how much every variance is smaller than searched says.
    """
    cosine, sine = cosine_sine(pose[2])
    information[:] = 0.0
    to_x, to_y, to_heading = 0.0, 0.0, 0.0
    for u in range(matches.size):
        if matches[u] == NONE:
            continue
        px, py = searched.points_m[u, 0], searched.points_m[u, 1]
        turned_x, turned_y = cosine * px - sine * py, sine * px + cosine * py
        weight = 1.0 / (searched.variances_m2[u] - less_m2)
        gap_x = known.grid.points_m[matches[u], 0] - pose[0] - turned_x
        gap_y = known.grid.points_m[matches[u], 1] - pose[1] - turned_y
        information[0, 0] += weight
        information[1, 1] += weight
        information[2, 2] += weight * (px * px + py * py)
        information[0, 2] -= weight * turned_y
        information[1, 2] += weight * turned_x
        to_x, to_y = to_x + weight * gap_x, to_y + weight * gap_y
        to_heading += weight * (turned_x * gap_y - turned_y * gap_x)
    for axis in range(3):
        information[axis, axis] += SMALLEST
    information[2, 0], information[2, 1] = information[0, 2], information[1, 2]
    return to_x, to_y, to_heading


@kernel
def refine(searched: Searched, known: IndexedMap, pose: FloatArray, takers: IntArray, matches: IntArray) -> float:
    """Move the pose (3,) onto its matches (n,), in place; returns the log of its Bayes factor against chance, with the
    prior of the region; anywhere in the map where there is none.

    Every local point counts, matched or not: a pose that leaves most of them unmatched is none. Nobody knows
    whether the map is bent here or as exact as one landmark: each is as likely.
    """
    information = np.zeros((3, 3))
    for step in range(REFINEMENTS):
        match(searched, known, pose, (2.0 if step == 0 else 1.0) * REFINED_GATE_SIGMAS, takers, matches)
        if (matches != NONE).sum() < 2:
            return -math.inf
        change = improve(searched, known, pose, matches, 0.0, information)
        if step > 0 and abs(change[0]) + abs(change[1]) < CONVERGED_M and abs(change[2]) < CONVERGED_RAD:
            break
    match(searched, known, pose, REFINED_GATE_SIGMAS, takers, matches)
    if (matches != NONE).sum() < 2:
        return -math.inf
    bent = log_factor(searched, known, pose, matches, 0.0, information)
    nearby = pose.copy()
    improve(searched, known, nearby, matches, searched.bent_m2, information)
    exact = log_factor(searched, known, nearby, matches, searched.bent_m2, information)
    return bent if bent == exact else max(bent, exact) + logarithm(0.5 + 0.5 * exponential(-abs(bent - exact)))


@kernel
def improve(
    searched: Searched, known: IndexedMap, pose: FloatArray, matches: IntArray, less_m2: float, information: FloatArray
) -> FloatArray:
    """Move the pose (3,) to where the squares of its matches are least, as they look from here; returns by how much."""
    to_x, to_y, to_heading = information_at(searched, known, pose, matches, less_m2, information)
    step = np.array(((to_x,), (to_y,), (to_heading,)))
    if not eliminate(information.copy(), step):
        step[:] = 0.0
    pose += step[:, 0]
    pose[2] = wrapped(pose[2])
    return step[:, 0]


@kernel
def log_factor(
    searched: Searched, known: IndexedMap, pose: FloatArray, matches: IntArray, less_m2: float, information: FloatArray
) -> float:
    """Log of the Bayes factor of a pose with its matches (n,), the prior of the region included."""
    information_at(searched, known, pose, matches, less_m2, information)
    cosine, sine = cosine_sine(pose[2])
    value = 0.0
    for u in range(matches.size):
        if matches[u] == NONE:
            value += logarithm(1.0 - DETECTION)
            continue
        px, py = searched.points_m[u, 0], searched.points_m[u, 1]
        gap_x = known.grid.points_m[matches[u], 0] - pose[0] - cosine * px + sine * py
        gap_y = known.grid.points_m[matches[u], 1] - pose[1] - sine * px - cosine * py
        square = gap_x * gap_x + gap_y * gap_y
        value += ratio(square, searched.variances_m2[u] - less_m2, known.densities[matches[u]])
    determinant = determinant_of_three(information)
    if determinant <= 0.0:
        return -math.inf
    value += 1.5 * logarithm(2.0 * math.pi) - 0.5 * logarithm(determinant)
    region = searched.region
    if region.variance_m2 == math.inf:
        return value - logarithm(2.0 * math.pi * known.area_m2)
    spread = np.eye(3)
    eliminate(information.copy(), spread)
    spread[0, 0] += region.variance_m2
    spread[1, 1] += region.variance_m2
    spread[2, 2] += region.variance_rad2
    off = np.array((pose[0] - region.x, pose[1] - region.y, wrapped(pose[2] - region.heading)))
    right = off.copy().reshape(3, 1)
    eliminate(spread.copy(), right)
    square = float((off * right[:, 0]).sum())
    value -= 0.5 * (square + logarithm(determinant_of_three(spread)) + 3.0 * logarithm(2.0 * math.pi))
    return value
