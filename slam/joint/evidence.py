"""What one scan says for and against the pose: landmarks that should be seen, and which of them were."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, IntArray
from slam.compiled import kernel
from slam.joint.association import distance_to
from slam.joint.measurement import JointArrays
from slam.observations import FeatureRows
from slam.settings.tuning import Tuning
from slam.visibility import SightLine, in_clear_view, sensor_pose, sighting_of

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
class Confidence:
    """What the scans before said about the pose.

    settled_before: number of the scan before which a landmark must have been made to speak for or against the pose.
    lost: nothing may be written into the map, because what is seen does not belong where the pose says.
    """

    settled_before: int = 0
    lost: bool = False


CONFIDENT = Confidence()


def score(
    joint: JointArrays,
    places: IntArray,
    settled: BoolArray,
    features: FeatureRows,
    chosen: IntArray,
    sight: SightLine,
    tuning: Tuning,
) -> Evidence:
    """Evidence of one scan before it is folded in.

    places (k,): landmarks of the predicted joint state that can be in view; settled (k,): which of them count. chosen
    (K,): number of a landmark among places, or a verdict.
    """
    known, found, missed, squares = _score(joint, places, settled, features, chosen, sight, tuning)
    return Evidence(known, found, missed, squares / max(found, 1))


@kernel
def _score(
    joint: JointArrays,
    places: IntArray,
    settled: BoolArray,
    features: FeatureRows,
    chosen: IntArray,
    sight: SightLine,
    tuning: Tuning,
) -> tuple[int, int, int, float]:
    """Known, found, missed, and the sum of the squared distances of the found ones."""
    sensor = sensor_pose(joint.mean, joint.mount)
    anywhere = SightLine(0.0, 0.0, 0.0, sight.ranges_m[:0])
    seen = np.zeros(places.size, dtype=np.bool_)
    known, found, missed, squares = 0, 0, 0, 0.0
    for feature in range(chosen.size):
        index = chosen[feature]
        if index < 0:
            continue
        seen[index] = True
        if settled[index]:
            sighting = sighting_of(features, feature)
            square, _ = distance_to(joint.mean, joint.covariance, joint.mount, places[index], sighting)
            known += 1
            found += 1
            squares += square
    for index in range(places.size):
        x, y = joint.mean[places[index]], joint.mean[places[index] + 1]
        if seen[index] or not settled[index] or not in_clear_view(x, y, sensor, anywhere, tuning):
            continue
        known += 1
        if in_clear_view(x, y, sensor, sight, tuning):
            missed += 1
    return known, found, missed, squares
