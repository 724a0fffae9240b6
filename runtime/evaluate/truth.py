"""The reference that a data set brings along, as it is attached to an imported run."""

import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray

ATTACHMENT = "truth.npz"


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
