"""How well points lie on the ground of a map, at every position and heading, and at the best pose nearby."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.arithmetic.functions import cosine_sine
from slam.compiled import kernel, leaf
from slam.maps.occupancy_grid import OccupancyArray
from slam.scan_search.ground import CellArray

HEADINGS = 120  # around the circle
QUARTERS = 4  # of the circle: in each the best heading of a position is kept
LEAST_SHARE = 0.3  # of the points; a pose is dropped as soon as it cannot reach it
STEPS = ((1.0, 0.02, 3), (0.5, 0.01, 1))  # cells, rad and steps to either side by which a pose is refined
TURNS = 2  # steps of the heading to either side

CountArray = NDArray[np.int32]


@kernel
def try_headings(
    coarse: OccupancyArray,
    places: CellArray,
    points: FloatArray,
    first: int,
    most_looks: int,
    best: CountArray,
    headings: CountArray,
) -> tuple[int, int]:
    """Try headings from the first on, at every place (D, 2), until so many cells were looked up; returns the next
    heading and the number of looks.

    points (n, 2): ahead and left, in cells. best, headings (D, QUARTERS): the best count so far, and where it was.
    """
    rows, columns = coarse.shape
    count = len(points)
    floor = LEAST_SHARE * count
    right, up = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    looks, heading = 0, first
    while heading < HEADINGS and looks < most_looks:
        angle = 2.0 * math.pi * heading / HEADINGS
        cosine, sine = cosine_sine(angle)
        quarter = heading * QUARTERS // HEADINGS
        for index in range(count):
            right[index] = math.floor(cosine * points[index, 0] - sine * points[index, 1] + 0.5)
            up[index] = math.floor(sine * points[index, 0] + cosine * points[index, 1] + 0.5)
        for place in range(len(places)):
            total = 0
            for index in range(count):
                row, column = places[place, 0] + up[index], places[place, 1] + right[index]
                looks += 1
                if 0 <= row < rows and 0 <= column < columns:
                    total += coarse[row, column]
                if total + count - index - 1 < floor:
                    break
            if total > best[place, quarter]:
                best[place, quarter], headings[place, quarter] = total, heading
        heading += 1
    return heading, looks


@leaf
def lying(fine: OccupancyArray, points: FloatArray, x: float, y: float, heading: float) -> int:
    """Points (n, 2) that lie on something, less those that lie in the open; x and y in cells."""
    cosine, sine = cosine_sine(heading)
    total = 0
    for index in range(len(points)):
        row = math.floor(y + sine * points[index, 0] + cosine * points[index, 1])
        column = math.floor(x + cosine * points[index, 0] - sine * points[index, 1])
        if 0 <= row < fine.shape[0] and 0 <= column < fine.shape[1]:
            total += fine[row, column]
    return total


@kernel
def refine(fine: OccupancyArray, points: FloatArray, pose: FloatArray) -> int:
    """Move the pose (3,), in cells and rad, to the middle of the best ones nearby; returns how well the points lie."""
    for step, turn, reach in STEPS:
        best, equals = -len(points) - 1, 0
        total = np.zeros(3)
        for along in range(-reach, reach + 1):
            for across in range(-reach, reach + 1):
                for about in range(-TURNS, TURNS + 1):
                    x, y, heading = pose[0] + along * step, pose[1] + across * step, pose[2] + about * turn
                    value = lying(fine, points, x, y, heading)
                    if value > best:
                        best, equals = value, 0
                        total[:] = 0.0
                    if value == best:
                        equals += 1
                        total[0] += x
                        total[1] += y
                        total[2] += heading
        pose[:] = total / equals
    return lying(fine, points, pose[0], pose[1], pose[2])
