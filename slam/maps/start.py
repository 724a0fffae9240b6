"""How a drive begins in a map that an earlier one has left."""

import hashlib
import struct
from dataclasses import dataclass

import numpy as np

from slam.joint.gaussian import DECIDED, JointGaussian, Variant
from slam.maps.joint_map import JointMap, put_map, tie_pose
from slam.pose import Pose2

READ_OFF_M, READ_OFF_RAD = 0.5, 0.1  # standard deviations of a pose that a person gives
SPREAD = np.diag((READ_OFF_M**2, READ_OFF_M**2, READ_OFF_RAD**2))
ADDITIVE = Variant(jacobians="current")
"""For a frozen map: the invariant update turns the whole map with the heading, and a frozen one does not turn."""


@dataclass(frozen=True, slots=True, eq=False)
class MapStart:
    """known: the saved map. localise_only: nothing is written into it. pose: map_from_body at the first scan."""

    known: JointMap
    localise_only: bool
    pose: Pose2

    def digest(self) -> bytes:
        """16 bytes over all of it: the state that a run begins with."""
        told = struct.pack("<?ddd", self.localise_only, *self.pose.as_array().tolist())
        return hashlib.blake2b(self.known.digest() + told, digest_size=16).digest()


def variant_for(start: MapStart | None) -> Variant:
    """Of the joint Gaussian that begins so."""
    return ADDITIVE if start is not None and start.localise_only else DECIDED


def begin_in_map(joint: JointGaussian, start: MapStart) -> None:
    """Put a joint Gaussian that has seen nothing yet into a saved map, at a pose that was read off it."""
    put_map(joint, start.known, start.localise_only)
    tie_pose(joint, start.pose, SPREAD)
