"""Whether a saved map suits a rover, and whether it is in itself in order."""

import math
from dataclasses import dataclass

import numpy as np

from runtime.errors import ConfigurationError, NotAMapError
from runtime.map_files.map_file import SavedMap
from runtime.settings.configuration import Configuration, load_configuration_text
from slam.maps.joint_map import JointMap
from slam.pose import Pose2
from slam.recognise.attempt import LEAST_MATCHES

SAME_MOUNT_M, SAME_MOUNT_RAD = 0.02, 0.01
TWINS_M = 0.2  # two landmarks nearer than this, and than three deviations, are likely one thing
LARGEST_SIGMA_M = 5.0


@dataclass(frozen=True, slots=True)
class Fitness:
    """refusal: why the map cannot be used, "" where it can. notes: differences that do not hinder, in sentences."""

    refusal: str
    notes: tuple[str, ...]


def configuration_of(saved: SavedMap, name: str) -> Configuration:
    """That of the rover that made a map. Raises NotAMapError where only another release understands it."""
    try:
        return load_configuration_text(saved.facts.configuration_text, source=name)
    except ConfigurationError as error:
        first, *_ = str(error).partition("; ")
        raise NotAMapError(f"{first}; another release wrote this map: use that one, or save a new map") from error


def too_small(joint: JointMap) -> str:
    """Why no place in a map can be recognised, "" where one can."""
    if len(joint) >= LEAST_MATCHES or len(joint.views):
        return ""
    return f"{len(joint)} landmarks and no view of walls, but a place is recognised by {LEAST_MATCHES}, or by walls"


def suits(saved: SavedMap, name: str, configuration: Configuration) -> Fitness:
    """How the sensor and mount that made a map differ from those of a rover. Raises NotAMapError."""
    made, here = configuration_of(saved, name).slam, configuration.slam
    for key, was, wants in (
        ("slam.front_end.kind", made.front_end.kind, here.front_end.kind),
        ("slam.association.strategy", made.association.strategy, here.association.strategy),
    ):
        if was != wants and ("given" in (was, wants) or "known" in (was, wants)):
            return Fitness(
                f"{name} was made by another kind of sensor ({key} = {was}, here {wants}); save a new map", ()
            )
    notes = []
    if made.mount.upside_down != here.mount.upside_down:
        notes.append(
            f"{name} was made with the laser {'upside down' if made.mount.upside_down else 'upright'}, "
            "which it is not here; that is right only if the laser was turned over since then"
        )
    shift_m = math.hypot(made.mount.x_m - here.mount.x_m, made.mount.y_m - here.mount.y_m)
    turn_rad = abs(math.remainder(made.mount.yaw_rad - here.mount.yaw_rad, 2.0 * math.pi))
    if shift_m > SAME_MOUNT_M or turn_rad > SAME_MOUNT_RAD:
        notes.append(
            f"{name} was made with another mount of the laser, {shift_m:.2f} m and "
            f"{math.degrees(turn_rad):.1f} deg from the one here; landmarks do not depend on the mount if "
            "both are right"
        )
    if made.front_end != here.front_end or made.view != here.view:
        differing = [
            key
            for table in ("front_end", "view")
            for key, value in getattr(made, table).model_dump().items()
            if getattr(here, table).model_dump()[key] != value
        ]
        notes.append(f"{name} was made with other settings of the sensor: {', '.join(differing)}")
    return Fitness("", tuple(notes))


def findings(saved: SavedMap) -> list[str]:
    """What in a map is suspicious, a sentence each."""
    landmarks = saved.joint.landmarks
    small = too_small(saved.joint)
    found = [f"{small}: a run in it needs --start-at, and one that is lost does not find back"] if small else []
    widest = np.sqrt(np.maximum(np.linalg.eigvalsh(landmarks.covariances_m2)[:, -1], 0.0))
    vague = int((widest > LARGEST_SIGMA_M).sum())
    if vague:
        found.append(f"landmarks known no better than to {LARGEST_SIGMA_M:g} m: {vague}; a loop was never closed")
    if len(saved.joint.block_m2) and np.linalg.eigvalsh(saved.joint.block_m2)[0] < -1e-6:
        found.append("the covariance of its landmarks is not positive, which is impossible")
    twins = _twins(landmarks.means_m)
    if twins:
        found.append(f"landmarks less than {TWINS_M:g} m apart, where one object may be stored twice: {twins} pairs")
    return found


def distance_outside(saved: SavedMap, pose: Pose2) -> float:
    """Metres from a pose to the nearest landmark."""
    gaps = saved.joint.means_m - (pose.x_m, pose.y_m)
    return float(np.hypot(gaps[:, 0], gaps[:, 1]).min())


def _twins(points_m: np.ndarray) -> int:
    from scipy.spatial import cKDTree  # slow to import, and only this asks for it

    tree = cKDTree(points_m)
    return (int(tree.count_neighbors(tree, TWINS_M)) - len(points_m)) // 2  # a list of pairs could be endless
