"""The poses of a drive as arrays, and as a TUM file that evo reads."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from drivers.measurements import FloatArray, IntArray
from runtime.atomic_write import atomic_write
from runtime.evaluate.rows import tum_text
from slam.estimate import Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses in the frame of the map, one for each estimate.

    stamps_ns (n,): host monotonic time. poses (n, 3): x m, y m, heading rad. covariances (n, 3, 3) over the same.
    """

    stamps_ns: IntArray
    poses: FloatArray
    covariances: FloatArray

    @classmethod
    def of(cls, estimates: Iterable[Estimate]) -> Self:
        """The poses of these estimates, which are not kept."""
        rows = [
            (
                each.stamp_ns,
                (each.map_from_body.x_m, each.map_from_body.y_m, each.map_from_body.heading_rad),
                each.covariance,
            )
            for each in estimates
        ]
        stamps, poses, covariances = zip(*rows, strict=True) if rows else ((), (), ())
        return cls(
            np.array(stamps, dtype=np.int64),
            np.array(poses, dtype=np.float64).reshape(-1, 3),
            np.array(covariances, dtype=np.float64).reshape(-1, 3, 3),
        )

    def write_tum(self, path: Path | str) -> None:
        """Write "time x y z qx qy qz qw" for each pose, time in seconds. Raises OSError."""
        rows = np.column_stack((self.stamps_ns * 1e-9, self.poses))
        atomic_write(Path(path), tum_text(rows))
