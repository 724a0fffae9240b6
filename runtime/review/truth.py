"""What an imported data set knows of the truth, drawn onto the map of a run."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.errors import UsageError
from runtime.evaluate.errors import LEAST_FIT_POINTS, rigid_fit
from runtime.evaluate.rows import poses_at
from runtime.evaluate.truth import DataSetTruth
from runtime.record.reader import RunReader
from runtime.record.trajectories import read_trajectories
from runtime.settings.configuration import load_configuration_text
from slam.pose import composed


@dataclass(frozen=True, slots=True, eq=False)
class TruthTrack:
    """Places (n, 2) in the map frame at stamps (n,), and how far the estimate was from each (n,), in m.

    The set has a frame of its own: the whole track is brought onto the map by the best rigid motion, as
    `infant evaluate` does. landmarks_m (k, 2): true landmarks, none where the set has none.
    """

    stamps_ns: NDArray[np.int64]
    places_m: FloatArray
    errors_m: FloatArray
    landmarks_m: FloatArray
    name: str


def truth_track(run: RunReader) -> TruthTrack | None:
    """The track of a run with estimates, None where its data set has no places or too few of them were passed."""
    held = DataSetTruth.from_attachments(run.attachments)
    rows = None if held is None else held.fixes if held.fixes is not None else held.poses
    if held is None or rows is None:
        return None
    try:
        estimated = read_trajectories(RunReader(run.folder.path)).estimated
    except UsageError:
        return None  # no estimates: nothing to lay it on
    mount = load_configuration_text(run.header.configuration_text).slam.mount
    offset = held.point((mount.x_m, mount.y_m, mount.yaw_rad))
    points_m = composed(poses_at(estimated, rows[:, 0]), np.array(offset))[:, :2]
    passed = np.isfinite(points_m[:, 0])
    if passed.sum() < LEAST_FIT_POINTS:
        return None
    map_from_set = rigid_fit(rows[passed, 1:3], points_m[passed])
    places_m = map_from_set.transform(rows[passed, 1:3])
    landmarks_m = np.empty((0, 2)) if held.landmarks is None else map_from_set.transform(held.landmarks[:, 1:3])
    errors_m = np.linalg.norm(places_m - points_m[passed], axis=1)
    stamps_ns = (rows[passed, 0] * 1e9).astype(np.int64)
    return TruthTrack(stamps_ns, places_m, errors_m, landmarks_m, "GPS" if held.fixes is not None else held.pose_kind)
