"""Motion models, and the unscented accumulation of many small motions into one increment.

One row per segment of constant motion:
    0 duration s, 1 and 2 controls, 3 lateral displacement m, 4 and 5 variances of the controls,
    6, 7, 8 additional variances forward m^2, sideways m^2, heading rad^2 (in the frame of the moving body)
Controls: DIFFERENTIAL left and right travel m; STEERED speed m/s and steering rad; RATES speed m/s and yaw rate
rad/s; ARC distance m and turn rad.
Geometry (7,): tread, wheel base, offset of the measured wheel, steering scale, steering bias, two travel factors.
"""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.functions import cosine_sine
from slam.compiled import kernel
from slam.settings.sigma_points import UnscentedWeights
from slam.unscented import square_root_into

DIFFERENTIAL, STEERED, RATES, ARC = 0, 1, 2, 3
SEGMENT_COLUMNS = 9


@kernel
def arc(model: int, geometry: FloatArray, duration_s: float, first: float, second: float) -> tuple[float, float]:
    """Distance m and turn rad that the two controls mean over one segment."""
    if model == DIFFERENTIAL:
        left, right = first * geometry[5], second * geometry[6]
        return 0.5 * (left + right), (right - left) / geometry[0]
    if model == STEERED:
        cosine, sine = cosine_sine(geometry[3] * second + geometry[4])
        slope = sine / cosine
        speed = first / (1.0 - slope * geometry[2] / geometry[1])
        return speed * duration_s, speed * duration_s * slope / geometry[1]
    if model == RATES:
        return first * duration_s, second * duration_s
    return first, second


@kernel
def exact_arc(
    x: float, y: float, heading: float, distance: float, lateral: float, turn: float
) -> tuple[float, float, float]:
    """Pose after driving a circular arc: the exponential of a constant twist, without a small-angle formula."""
    if abs(turn) < 1e-4:
        along, across = 1.0 - turn * turn / 6.0, turn / 2.0 - turn * turn * turn / 24.0
    else:
        turned_cosine, turned_sine = cosine_sine(turn)
        along, across = turned_sine / turn, (1.0 - turned_cosine) / turn
    ahead = distance * along - lateral * across
    left = distance * across + lateral * along
    cosine, sine = cosine_sine(heading)
    return x + cosine * ahead - sine * left, y + sine * ahead + cosine * left, heading + turn


@kernel
def accumulate(
    mean: FloatArray,
    covariance: FloatArray,
    tracks: FloatArray,
    segments: FloatArray,
    model: int,
    geometries: FloatArray,
    weights: UnscentedWeights,
) -> None:
    """Carry mean (3,), covariance (3, 3) and tracks (1 + s, 3) through segments (n, 9), all in place.

    Augments (pose, control noise), n = 5, and pushes 11 points through the motion for every segment (method, step 1).
    geometries (1 + s, 7): the nominal one and s copies with one constant moved by its standard deviation each; tracks
    are the poses that follow from them: an error that is the same in every segment adds up and does not average out.
    """
    points = np.empty((11, 5))
    images = np.empty((11, 3))
    root = np.empty((3, 3))
    for row in range(segments.shape[0]):
        duration, lateral = segments[row, 0], segments[row, 3]
        square_root_into(covariance, root)
        for point in range(11):
            points[point, 0], points[point, 1], points[point, 2] = mean[0], mean[1], mean[2]
            points[point, 3], points[point, 4] = segments[row, 1], segments[row, 2]
        for column in range(3):
            for axis in range(3):
                points[1 + column, axis] += weights.scale * root[axis, column]
                points[6 + column, axis] -= weights.scale * root[axis, column]
        for control in range(2):
            step = weights.scale * math.sqrt(segments[row, 4 + control])
            points[4 + control, 3 + control] += step
            points[9 + control, 3 + control] -= step
        for point in range(11):
            distance, turn = arc(model, geometries[0], duration, points[point, 3], points[point, 4])
            images[point, 0], images[point, 1], images[point, 2] = exact_arc(
                points[point, 0], points[point, 1], points[point, 2], distance, lateral, turn
            )
        for axis in range(3):
            total = weights.mean_centre * images[0, axis]
            for point in range(1, 11):
                total += weights.other * images[point, axis]
            mean[axis] = total
        for i in range(3):
            for j in range(i + 1):
                total = weights.covariance_centre * (images[0, i] - mean[i]) * (images[0, j] - mean[j])
                for point in range(1, 11):
                    total += weights.other * (images[point, i] - mean[i]) * (images[point, j] - mean[j])
                covariance[i, j] = total
                covariance[j, i] = total
        cosine, sine = cosine_sine(mean[2])
        forward, sideways = segments[row, 6], segments[row, 7]
        covariance[0, 0] += cosine * cosine * forward + sine * sine * sideways
        covariance[1, 1] += sine * sine * forward + cosine * cosine * sideways
        covariance[0, 1] += cosine * sine * (forward - sideways)
        covariance[1, 0] = covariance[0, 1]
        covariance[2, 2] += segments[row, 8]
        for track in range(tracks.shape[0]):
            distance, turn = arc(model, geometries[track], duration, segments[row, 1], segments[row, 2])
            tracks[track, 0], tracks[track, 1], tracks[track, 2] = exact_arc(
                tracks[track, 0], tracks[track, 1], tracks[track, 2], distance, lateral, turn
            )
