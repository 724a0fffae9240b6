"""Which landmarks of the joint state lie where, which of them are overdue, and their own part of the covariance."""

import math

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import kernel, leaf
from slam.joint.measurement import FIRST_PLACE, JointArrays
from slam.settings.tuning import Tuning
from slam.visibility import SightLine, in_clear_view, sensor_pose

DOUBLE_M = 0.1  # landmarks that stand nearer to each other are one: no two features of a scan do


@leaf
def update_existence(
    joint: JointArrays, places: IntArray, seen: BoolArray, log_odds: FloatArray, sight: SightLine, tuning: Tuning
) -> None:
    """(6): raise the log-odds (k,) of landmarks that were seen, lower those of the overdue, in place."""
    sensor = sensor_pose(joint.mean, joint.mount)
    for index in range(places.size):
        x, y = joint.mean[places[index]], joint.mean[places[index] + 1]
        if seen[index]:
            log_odds[index] = min(log_odds[index] + tuning.log_odds_seen, tuning.log_odds_max)
        elif tuning.existence and in_clear_view(x, y, sensor, sight, tuning):
            log_odds[index] -= sight.certainty * tuning.log_odds_missed


@kernel
def neighbour_distances(mean: FloatArray, places: IntArray, others: IntArray) -> FloatArray:
    """Distance m of each landmark at places (k,) to the nearest other one of others (l,); inf where it is the only
    one.
    """
    nearest = np.full(places.size, math.inf)
    for index in range(places.size):
        x, y = mean[places[index]], mean[places[index] + 1]
        for at in others:
            dx, dy = mean[at] - x, mean[at + 1] - y
            if at != places[index]:
                nearest[index] = min(nearest[index], dx * dx + dy * dy)
    root: FloatArray = np.sqrt(nearest)
    return root


@kernel
def standing_double(mean: FloatArray, places: IntArray, identities: IntArray) -> BoolArray:
    """(k,) which landmarks at places (k,) stand where one of a smaller identity does, which is older."""
    double = np.zeros(places.size, dtype=np.bool_)
    for index in range(places.size):
        x, y = mean[places[index]], mean[places[index] + 1]
        for other in range(places.size):
            dx, dy = mean[places[other]] - x, mean[places[other] + 1] - y
            if identities[other] < identities[index] and dx * dx + dy * dy < DOUBLE_M * DOUBLE_M:
                double[index] = True
                break
    return double


@kernel
def places_within(mean: FloatArray, n: int, x: float, y: float, radius_m: float) -> IntArray:
    """Places of the landmarks nearer than a radius to a point."""
    found = np.empty((n - FIRST_PLACE) // 2, dtype=np.int64)
    count = 0
    for at in range(FIRST_PLACE, n, 2):
        dx, dy = mean[at] - x, mean[at + 1] - y
        if dx * dx + dy * dy <= radius_m * radius_m:
            found[count] = at
            count += 1
    return found[:count]


@kernel
def block(mean: FloatArray, covariance: FloatArray, places: IntArray) -> tuple[FloatArray, FloatArray]:
    """Copies of what stands before the landmarks and of those at places (k,): mean (6 + 2 k,) and covariance."""
    k = places.size
    rows = np.empty(FIRST_PLACE + 2 * k, dtype=np.int64)
    rows[:FIRST_PLACE] = np.arange(FIRST_PLACE)
    for index in range(k):
        rows[FIRST_PLACE + 2 * index], rows[FIRST_PLACE + 1 + 2 * index] = places[index], places[index] + 1
    part = np.empty((rows.size, rows.size))
    for row in range(rows.size):
        for column in range(rows.size):
            part[row, column] = covariance[rows[row], rows[column]]
    return mean[rows], part
