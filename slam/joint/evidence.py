"""What one scan says for and against the pose: landmarks that should be seen, and which of them were."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.compiled import kernel
from slam.joint.association import distance_to
from slam.settings.tuning import Tuning
from slam.visibility import NO_SIGHT, in_clear_view, sensor_pose

KNOWN, FOUND, MISSED, SQUARES = range(4)

SETTLED_SCANS = 30  # scans after which a landmark speaks for or against the pose: a walker has gone by then


@dataclass(frozen=True, slots=True)
class Evidence:
    """Of the landmarks that were settled before.

    known: within range and angle; found: those of them that a feature matched; missed: those that were not although
    nothing stood before them. square: mean squared Mahalanobis distance of the found ones to the predicted pose, 2 in
    a filter that is consistent; 0 without any.
    """

    known: int = 0
    found: int = 0
    missed: int = 0
    square: float = 0.0


@dataclass(frozen=True, slots=True)
class Standing:
    """What the scans before said about the pose.

    settled_before: number of the scan before which a landmark must have been made to speak for or against the pose.
    lost: nothing may be written into the map, because what is seen does not belong where the pose says.
    """

    settled_before: int = 0
    lost: bool = False


TRUSTED = Standing()


def weigh(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    places: IntArray,
    settled: BoolArray,
    features: FloatArray,
    chosen: IntArray,
    sight: FloatArray,
    tuning: Tuning,
) -> Evidence:
    """Evidence of one scan before it is folded in.

    mean (N,), covariance (N, N): the predicted joint state; places (k,): landmarks that can be in view; settled (k,).
    features (K, 6) as slam.joint_association takes them; chosen (K,): number of a landmark among places, or a verdict.
    """
    sums = np.zeros(4)
    _weigh(mean, covariance, mount, places, settled, features, chosen, sight, NO_SIGHT, tuning, sums)
    found = int(sums[FOUND])
    return Evidence(int(sums[KNOWN]), found, int(sums[MISSED]), float(sums[SQUARES]) / max(found, 1))


@kernel
def _weigh(
    mean: FloatArray,
    covariance: FloatArray,
    mount: FloatArray,
    places: IntArray,
    settled: BoolArray,
    features: FloatArray,
    chosen: IntArray,
    sight: FloatArray,
    no_sight: FloatArray,
    tuning: Tuning,
    sums: FloatArray,
) -> None:
    """Add known, found, missed and the squared distances of the found ones to sums (4,)."""
    sensor = sensor_pose(mean, mount)
    seen = np.zeros(places.size, dtype=np.bool_)
    for feature in range(chosen.size):
        index = chosen[feature]
        if index < 0:
            continue
        seen[index] = True
        if settled[index]:
            square, _ = distance_to(mean, covariance, mount, places[index], features[feature])
            sums[KNOWN] += 1.0
            sums[FOUND] += 1.0
            sums[SQUARES] += square
    for index in range(places.size):
        at = places[index]
        if seen[index] or not settled[index] or not in_clear_view(mean[at], mean[at + 1], sensor, no_sight, tuning):
            continue
        sums[KNOWN] += 1.0
        if in_clear_view(mean[at], mean[at + 1], sensor, sight, tuning):
            sums[MISSED] += 1.0
