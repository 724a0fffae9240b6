"""A scan that the rover keeps, and where another one lies on it."""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.functions import cosine_sine
from slam.front_end.alignment_kernels import EarlierScans
from slam.front_end.wide_search import View
from slam.maps.views import CentimetreArray
from slam.pose import Pose2

LYING_SHARE = 0.6  # of a scan's points that are on surfaces of the keyframe, where it lies on them


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan as it was taken: points_m and normals (n, 2) in the laser's frame, single precision; first_rad,
    spacing_rad: where its beams point. kept_cm: what a saved map keeps of it. scan: its number in the map.
    """

    points_m: FloatArray
    kept_cm: CentimetreArray
    normals: FloatArray
    first_rad: float
    spacing_rad: float
    scan: int

    @property
    def field_of_view_rad(self) -> float:
        """Angle between its outermost beams."""
        return (len(self.points_m) - 1) * self.spacing_rad

    @property
    def view(self) -> View:
        """What it saw."""
        return View(self.points_m.astype(np.float64), self.first_rad, self.spacing_rad)

    def surfaces(self, laser_from_body: Pose2) -> EarlierScans:
        """What another scan is laid onto, its motion beginning where the body stood."""
        start = laser_from_body
        return EarlierScans(
            self.points_m.astype(np.float64)[None],
            self.normals.astype(np.float64)[None],
            np.array([(start.x_m, start.y_m, *cosine_sine(start.heading_rad))]),
            self.first_rad,
            self.spacing_rad,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """Where a scan lies on a keyframe: predicted and found motion (3,), information (3, 3), the part of it that the
    prediction holds, points on surfaces, of how many.
    """

    predicted: FloatArray
    motion: FloatArray
    information: FloatArray
    held: FloatArray
    count: int
    points: int

    @property
    def lies(self) -> bool:
        """Whether the scan lies on what the keyframe saw; from a wrong pose one in a hundred does."""
        return self.count >= LYING_SHARE * self.points

    def is_near(self, reach_m: float, reach_rad: float) -> bool:
        """Whether the scan was predicted so near the keyframe."""
        return bool(math.hypot(self.predicted[0], self.predicted[1]) < reach_m and abs(self.predicted[2]) < reach_rad)
