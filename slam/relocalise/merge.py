"""Two saved maps become one: a place of the second is recognised in the first, and the second is laid there."""

from dataclasses import dataclass, replace

import numpy as np

from slam.arithmetic.functions import lengths
from slam.joint.evidence import SETTLED_SCANS
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.maps.joint_map import JointMap, put_map, take_map, tie_pose
from slam.observations import IDENTITIES_PER_SCAN
from slam.pose import Pose2
from slam.recognise.attempt import NOTHING, Hypothesis, recognise
from slam.recognise.local_points import local_points
from slam.recognise.map_index import MapIndex
from slam.recognise.scale import Scale
from slam.relocalise.island import Island
from slam.settings.slam import SlamSettings

MOST_PLACES = 60  # of the second map are looked for in the first
APART_SHARE = 0.5  # of the sensor's reach, from one place to the next
EXACT = 1e-6 * np.eye(3)  # a place is a point among landmarks, and not where a rover was


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """joint: both maps in the frame of the first, None where no place of the second was recognised. found: the best."""

    joint: JointMap | None
    found: Hypothesis


def merge_maps(settings: SlamSettings, first: JointMap, second: JointMap) -> Merged:
    """What both have around the recognised place is joined with all that is known of it; what the second has far from
    there is turned along, four times as vague and a metre more.
    """
    scale = Scale.of(settings)
    reach_m = settings.view.range_max_m + settings.view.range_margin_m
    into, source = _joint_of(settings, first), _joint_of(settings, _renamed(second, first.scans + SETTLED_SCANS))
    island = Island(1, into, Keyframes(into, Pose2()), MapIndex(scale))
    island.rooting.root(into.scans, 0)
    island.follow(None)
    best, best_place = NOTHING, Pose2()
    for place in _places(second, APART_SHARE * settings.view.range_max_m):
        tie_pose(source, place, EXACT)
        found = recognise(island.index, local_points(source.state, scale))
        if found.odds > best.odds:
            best, best_place = found, place
    if not best.acceptable:
        return Merged(None, best)
    tie_pose(source, best_place, EXACT)
    joined = island.take_in(source, reach_m, best, best.map_from_body)
    turned = second.views.turned(best.map_from_body @ best_place.inverse())
    return Merged(None if joined is None else take_map(into, first.views.joined(turned)), best)


def _joint_of(settings: SlamSettings, known: JointMap) -> JointGaussian:
    joint = JointGaussian(settings.joint, settings.mount.as_pose(), settings.tuning())
    put_map(joint, known)
    return joint


def _renamed(known: JointMap, scans: int) -> JointMap:
    """The same map as if its drive had begun after so many scans: no landmark has a name of the other map."""
    return replace(known, identities=known.identities + scans * IDENTITIES_PER_SCAN, scans=known.scans + scans)


def _places(known: JointMap, apart_m: float) -> list[Pose2]:
    """Landmarks to stand at, no two of them near each other, those with most around them first."""
    gaps = lengths(known.means_m[:, None] - known.means_m)
    company = (gaps < apart_m).sum(axis=1)
    chosen: list[int] = []
    for number in np.argsort(-company, kind="stable").tolist():
        if len(chosen) < MOST_PLACES and all(gaps[number, other] >= apart_m for other in chosen):
            chosen.append(number)
    return [Pose2(*known.means_m[number].tolist()) for number in chosen]
