"""A rover is set down somewhere, with a map and no pose: when is it recognised, and how wrong is that?"""

import math

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.worlds import WorldKind
from runtime.studies.relocalisation.rover import StudiedRover
from runtime.studies.relocalisation.told_drives import ToldDrive, recorded, told_world
from slam.maps.joint_map import JointMap
from slam.maps.start import MapStart
from slam.observations import IDENTITIES_PER_SCAN

FARTHEST_M = 200.0  # driven without a recognition
IN_MAP_SHARE, IN_MAP_M = 0.3, 60.0  # so many features of a scan belong to the map within so many metres
NOT_AFTER = 0.97  # of a recording: later there is no way left to be recognised on
WORLD_WAY_M = 20.0


def kidnap_trial(
    data: str,
    name: str,
    share: float,
    count: int,
    seed: int,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """The map of the first `share` of a recording; the rover is set down at `count` moments of the rest.

    The truth is where the whole drive's own filter was.
    """
    drive = recorded(data, name, (share,))
    first = round(share * len(drive.seen))
    generator = np.random.default_rng(seed)
    moments = np.sort(generator.choice(np.arange(first, round(NOT_AFTER * len(drive.seen))), count, replace=False))
    known = drive.maps[first]
    return {
        "name": name,
        "landmarks": len(known),
        "kidnaps": [
            set_down(drive, known, moment, FARTHEST_M)
            | {"in_map": is_in_map(drive, known, moment), "passes": passes(drive, known, moment)}
            for moment in moments.tolist()
        ],
    }


def world_trial(
    kind: WorldKind,
    seed: int,
    exchanged: float,
    count: int,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """The map of one drive; the rover is set down at places of another, with other noise and a share of the landmarks
    exchanged.
    """
    mapping, drive = told_world(kind, seed, 0), told_world(kind, seed, 1, exchanged)
    rover = StudiedRover(mapping.settings)
    for seen in mapping.seen:
        rover.step(seen)
    known = rover.saved()
    moments = np.random.default_rng(seed).integers(0, round(0.9 * len(drive.seen)), count)
    return {
        "name": f"{kind}, {exchanged:.0%} exchanged" if exchanged else kind,
        "landmarks": len(known),
        "kidnaps": [
            set_down(drive, known, moment, WORLD_WAY_M) | {"in_map": True, "passes": len(known)}
            for moment in sorted(moments.tolist())
        ],
    }


def set_down(drive: ToldDrive, known: JointMap, moment: int, farthest_m: float) -> Result:
    """at: the scan; driven_m, seconds, error_m, odds and mirror_odds at the recognition, None where there was none."""
    rover = StudiedRover(drive.settings, MapStart(known, True, None))
    driven_m, best = 0.0, -math.inf
    for number in range(moment, len(drive.seen)):
        seen = drive.seen[number]
        driven_m += float(np.hypot(*seen.increment_mean[:2])) if number > moment else 0.0
        if driven_m > farthest_m:
            break
        found = rover.step(seen)
        figures = rover.relocaliser.figures
        best = max(best, figures["search_odds"], figures["search_scan_odds"])
        if found is None or found.is_new or rover.relocaliser.awaits_saved:
            continue
        return {
            "at": moment,
            "driven_m": round(driven_m, 2),
            "seconds": round((seen.stamp_ns - drive.seen[moment].stamp_ns) * 1e-9, 2),
            "error_m": round(distance_m(rover.pose.as_array(), drive.poses[number]), 3),
            "odds": round(found.odds, 1),
            "mirror_odds": round(found.mirror_odds, 1) if math.isfinite(found.mirror_odds) else None,
            "matches": found.matches,
        }
    nothing = dict.fromkeys(("driven_m", "seconds", "error_m", "mirror_odds", "matches"))
    return {"at": moment, **nothing, "odds": round(best, 1) if math.isfinite(best) else None}


def is_in_map(drive: ToldDrive, known: JointMap, moment: int) -> bool:
    """Whether the rover drives through the map within IN_MAP_M: by what the whole drive's filter matched."""
    newest = known.scans * IDENTITIES_PER_SCAN
    way_m = 0.0
    for number in range(moment, len(drive.seen)):
        way_m += float(np.hypot(*drive.seen[number].increment_mean[:2])) if number > moment else 0.0
        if way_m > IN_MAP_M:
            return False
        matched = drive.matched[number]
        if len(matched) and ((matched >= 0) & (matched < newest)).mean() >= IN_MAP_SHARE:
            return True
    return False


def passes(drive: ToldDrive, known: JointMap, moment: int) -> int:
    """How many landmarks of the map the whole drive's filter matched within IN_MAP_M. One that is seen alone, of three
    features, makes is_in_map true; nobody can be recognised by it.
    """
    own, seen = set(known.identities.tolist()), set[int]()
    way_m = 0.0
    for number in range(moment, len(drive.seen)):
        way_m += float(np.hypot(*drive.seen[number].increment_mean[:2])) if number > moment else 0.0
        if way_m > IN_MAP_M:
            break
        seen |= own.intersection(drive.matched[number].tolist())
    return len(seen)


def distance_m(pose: FloatArray, other: FloatArray) -> float:
    """Between two poses (3,)."""
    return float(np.hypot(*(pose[:2] - other[:2])))
