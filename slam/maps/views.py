"""What a rover saw from where, as a map keeps it: enough to recognise a place by its walls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.pose import Pose2

BEAMS = 120  # of a scan are kept
NOTHING_CM = -32768  # nothing came back
FARTHEST_CM = 32767
MOST_VIEWS = 20_000  # of a map, 10 MB: one for each metre of 20 km

CentimetreArray = NDArray[np.int16]


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """poses (K, 3), map_from_laser. points_cm (K, BEAMS, 2), laser's frame: NOTHING_CM where nothing came back."""

    poses: FloatArray
    points_cm: CentimetreArray

    def __len__(self) -> int:
        return len(self.poses)

    def points_m(self, number: int) -> FloatArray:
        """(p, 2) returns of one view, laser's frame."""
        points = self.points_cm[number].astype(np.float64)
        returned: FloatArray = 0.01 * points[points[:, 0] != NOTHING_CM]
        return returned

    def joined(self, others: "Views") -> "Views":
        """These and others of the same map."""
        return Views(np.vstack((self.poses, others.poses)), np.concatenate((self.points_cm, others.points_cm)))

    def thinned(self, most: int) -> "Views":
        """So many of them, evenly spread over the drives that they are of, or all."""
        if len(self) <= most:
            return self
        kept = np.arange(most) * len(self) // most
        return Views(self.poses[kept], self.points_cm[kept])

    def turned(self, new_from_old: Pose2) -> "Views":
        """The same in another map."""
        points_m, headings = new_from_old.transform(self.poses[:, :2]), new_from_old.heading_rad + self.poses[:, 2]
        return Views(np.column_stack((points_m, headings)), self.points_cm)


NO_VIEWS = Views(np.zeros((0, 3)), np.zeros((0, BEAMS, 2), dtype=np.int16))


def kept_points(points_m: FloatArray) -> CentimetreArray:
    """(BEAMS, 2) of a scan's points (n, 2), NaN where nothing came back: every so-many-th."""
    some = points_m[:: max(1, -(-len(points_m) // BEAMS))]
    known = np.isfinite(some).all(axis=1)
    kept = np.full((BEAMS, 2), NOTHING_CM, dtype=np.int16)
    kept[np.flatnonzero(known)] = np.clip(np.rint(100.0 * some[known]), -FARTHEST_CM, FARTHEST_CM)
    return kept
