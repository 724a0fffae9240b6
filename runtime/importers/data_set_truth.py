"""What a data set knows of the truth, kept inside the run so that evaluating it needs nothing else."""

import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runtime.importers.archive import Archive

ATTACHMENT = "truth.npz"
FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DataSetTruth:
    """Times are seconds of the run's stamps. None: the set does not have it.

    fixes (n, 3): t, x m, y m of the good GPS fixes. poses (n, 4): t, x m, y m, heading rad.
    pose_kind: what the poses are, in words. relations (n, 5): t1, t2 and the pose at t2 in the frame of that at t1.
    landmarks (n, 3): identity, x m, y m.
    """

    fixes: FloatArray | None = None
    poses: FloatArray | None = None
    pose_kind: str = ""
    relations: FloatArray | None = None
    landmarks: FloatArray | None = None

    def attachment(self) -> bytes:
        """As bytes; `from_attachment` gives it back."""
        arrays = {
            name: array
            for name in ("fixes", "poses", "relations", "landmarks")
            if (array := getattr(self, name)) is not None
        }
        stream = io.BytesIO()
        np.savez_compressed(stream, pose_kind=np.array(self.pose_kind), **arrays)
        return stream.getvalue()

    @classmethod
    def from_attachments(cls, attachments: Mapping[str, bytes]) -> "DataSetTruth | None":
        """The truth that a run holds, None when it holds none."""
        data = attachments.get(ATTACHMENT)
        if data is None:
            return None
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        return cls(pose_kind=str(arrays.pop("pose_kind")), **arrays)


def truth_of(archive: Archive) -> DataSetTruth | None:
    """The truth in an archive, None when there is none."""
    start_s = archive.start_s
    fixes = poses = relations = landmarks = None
    if "gt_xy" in archive:
        times_s = archive["gt_t"] - start_s
        if "gt_theta" in archive:
            poses = np.column_stack((times_s, archive["gt_xy"], archive["gt_theta"]))
        else:
            good = archive["gt_good"] if "gt_good" in archive else np.ones(len(times_s), bool)
            fixes = np.column_stack((times_s, archive["gt_xy"]))[good]
    if "rel" in archive:
        rows = archive["rel"]
        relations = np.column_stack((rows[:, :2] - start_s, rows[:, 2:4], rows[:, 7]))
    if "landmarks" in archive:
        landmarks = np.column_stack((archive["landmark_id"].astype(np.float64), archive["landmarks"]))
    if all(part is None for part in (fixes, poses, relations, landmarks)):
        return None
    return DataSetTruth(fixes, poses, str(archive.meta.get("gt_kind", "")), relations, landmarks)
