"""What one scan says for and against the pose: landmarks that should be seen, and which of them were.

A landmark that is missed speaks against the pose by as much as it is usually found. Detection is sticky: what was found
is found again, and a corner that is missed once is missed for long, because the rover sees it from behind or a door has
closed. So each landmark has a rate of being found again, all together one of being found after a miss, and both
are learnt while the pose can be believed.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.functions import logarithm
from slam.compiled import kernel, leaf
from slam.joint.association import distance_to
from slam.joint.measurement import JointArrays
from slam.observations import FeatureRows
from slam.settings.tuning import Tuning
from slam.visibility import CHANCE, SightLine, in_clear_view, is_in_sight, sensor_pose, sighting_of

SETTLED_SCANS = 30  # scans after which a landmark speaks for or against the pose: a walker has gone by then
FIRST_LOOKS, FIRST_FINDS = 4.0, 3.0  # what is presumed of a landmark that was found the last time
FIRST_LOOKS_AFTER_MISS, FIRST_FINDS_AFTER_MISS = 20.0, 8.0  # of those that were missed the last time, all together
MOST_LOOKS = 50.0  # the memory of a rate: a post seen from afar is found more often from near
MOST_LOOKS_AFTER_MISS = 500.0
MOST_OF_A_SCAN = 15.0  # log-odds; what is missed in one scan may have one cause that passes, as a slip of the wheels


@dataclass(frozen=True, slots=True)
class Evidence:
    """Of the landmarks that were settled before.

    known: within range and angle and not hidden; found: those of them that a feature matched; missed: those that were
    not although nothing stood before them. against: log-odds against the pose, from how often each is usually found.
    square: mean squared Mahalanobis distance of the found ones to the predicted pose, 2 in a filter that is consistent;
    0 without any.
    """

    known: int = 0
    found: int = 0
    missed: int = 0
    against: float = 0.0
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


class InView(NamedTuple):
    """Landmarks that can be in view.

    places (k,) in the predicted joint state; settled (k,): which of them count; undecided (k,): those that are not
    missed though unmatched, because a feature lay where they may be.
    """

    places: IntArray
    settled: BoolArray
    undecided: BoolArray


class DetectionRates(NamedTuple):
    """How often landmarks in clear view are found.

    Of those (k,) that can be in view: looks at each and finds, after it was found; whether it was missed the last time.
    after_miss (2,): looks and finds of all landmarks after a miss. from_elsewhere: the last look that counts was from
    another place; from one place all looks see the same.
    """

    looks: FloatArray
    finds: FloatArray
    missed: BoolArray
    after_miss: FloatArray
    from_elsewhere: bool


def score(
    joint: JointArrays,
    in_view: InView,
    features: FeatureRows,
    chosen: IntArray,
    sight: SightLine,
    rates: DetectionRates,
    tuning: Tuning,
) -> Evidence:
    """Evidence of one scan before it is folded in; rates are brought up to date in place.

    chosen (K,): number of a landmark among those in view, or a verdict.
    """
    known, found, missed, against, squares = _score(joint, in_view, features, chosen, sight, rates, tuning)
    against = min(max(against, -MOST_OF_A_SCAN), MOST_OF_A_SCAN)
    return Evidence(known, found, missed, against, squares / max(found, 1))


@leaf
def learn(rates: DetectionRates, index: int, is_found: bool) -> None:
    """Bring the rates up to date with one look at a landmark in clear view."""
    find = 1.0 if is_found else 0.0
    if rates.from_elsewhere and rates.missed[index]:
        fading = min(1.0, (MOST_LOOKS_AFTER_MISS - 1.0) / rates.after_miss[0])
        rates.after_miss[0] = fading * rates.after_miss[0] + 1.0
        rates.after_miss[1] = fading * rates.after_miss[1] + find
    elif rates.from_elsewhere:
        fading = min(1.0, (MOST_LOOKS - 1.0) / max(rates.looks[index], 1.0))
        rates.looks[index] = fading * rates.looks[index] + 1.0
        rates.finds[index] = fading * rates.finds[index] + find
    rates.missed[index] = not is_found


@kernel
def _score(
    joint: JointArrays,
    in_view: InView,
    features: FeatureRows,
    chosen: IntArray,
    sight: SightLine,
    rates: DetectionRates,
    tuning: Tuning,
) -> tuple[int, int, int, float, float]:
    """Known, found, missed, log-odds against the pose, and the sum of the squared distances of the found ones."""
    sensor = sensor_pose(joint.mean, joint.mount)
    places, by = in_view.places, np.full(in_view.places.size, -1)
    for feature in range(chosen.size):
        if chosen[feature] >= 0:
            by[chosen[feature]] = feature
    known, found, missed, against, squares = 0, 0, 0, 0.0, 0.0
    for index in range(places.size):
        x, y = joint.mean[places[index]], joint.mean[places[index] + 1]
        is_found = by[index] >= 0
        is_missed = not is_found and not in_view.undecided[index] and in_clear_view(x, y, sensor, sight, tuning)
        if rates.missed[index]:
            rate = rates.after_miss[1] / rates.after_miss[0]
        else:
            rate = (rates.finds[index] + FIRST_FINDS) / (rates.looks[index] + FIRST_LOOKS)
        if is_found or is_missed:
            learn(rates, index, is_found)
        if not in_view.settled[index]:
            continue
        rate = max(rate, CHANCE)
        if is_found:
            known, found = known + 1, found + 1
            against += logarithm(CHANCE / rate)
            sighting = sighting_of(features, by[index])
            squares += distance_to(joint.mean, joint.covariance, joint.mount, places[index], sighting)[0]
        elif is_missed:
            known, missed = known + 1, missed + 1
            against += logarithm((1.0 - CHANCE) / (1.0 - rate))
        elif is_in_sight(x, y, sensor, sight, tuning):
            known += 1
    return known, found, missed, against, squares
