"""How a drive begins in a map that an earlier one has left."""

import hashlib
import struct
from dataclasses import dataclass

import numpy as np

from slam.arithmetic.elementary import squared
from slam.joint.evidence import SETTLED_SCANS
from slam.joint.gaussian import DECIDED, JointGaussian, Variant
from slam.maps.joint_map import JointMap, put_map, tie_pose
from slam.pose import Pose2
from slam.settings.slam import SlamSettings

READ_OFF_M, READ_OFF_RAD = 0.5, 0.1  # standard deviations of a pose that a person gives
SPREAD = np.diag((squared(READ_OFF_M), squared(READ_OFF_M), squared(READ_OFF_RAD)))
ADDITIVE = Variant(jacobians="current")
"""For a frozen map: the invariant update turns the whole map with the heading, and a frozen one does not turn."""


@dataclass(frozen=True, slots=True, eq=False)
class MapStart:
    """known: the saved map. localise_only: nothing is written into it. pose: map_from_body at the first scan; None
    where the rover has to recognise its place first.
    """

    known: JointMap
    localise_only: bool
    pose: Pose2 | None

    def digest(self) -> bytes:
        """16 bytes over all of it: the state that a run begins with."""
        place = () if self.pose is None else tuple(self.pose.as_array().tolist())
        told = struct.pack(f"<?{len(place)}d", self.localise_only, *place)
        return hashlib.blake2b(self.known.digest() + told, digest_size=16).digest()


def first_maps(settings: SlamSettings, start: MapStart | None) -> tuple[JointGaussian, JointGaussian | None]:
    """The map that the drive begins in, and the saved one: the same where the pose is known, None where there is none.

    Where the place has to be recognised, the drive begins in a map of its own, whose landmarks are named after all of
    the saved one's.
    """
    here = JointGaussian(settings.joint, settings.mount.as_pose(), settings.tuning(), DECIDED)
    if start is None:
        return here, None
    saved = saved_map(settings, start)
    if start.pose is None:
        here.scans = start.known.scans + SETTLED_SCANS
        return here, saved
    tie_pose(saved, start.pose, SPREAD)
    return saved, saved


def saved_map(settings: SlamSettings, start: MapStart) -> JointGaussian:
    """The saved map, in which the pose is not known."""
    variant = ADDITIVE if start.localise_only else DECIDED
    saved = JointGaussian(settings.joint, settings.mount.as_pose(), settings.tuning(), variant)
    put_map(saved, start.known, start.localise_only)
    return saved
