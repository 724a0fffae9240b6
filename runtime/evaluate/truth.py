"""The reference that a data set brings along, as it is attached to an imported run."""

import io
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from runtime.errors import NotARunError
from runtime.printable import printable
from slam.pose import composed, inverted, wrap_rads

ATTACHMENT = "truth.npz"
LARGEST_BYTES = 64 << 20  # of all arrays together: two million poses
LONGEST_KIND = 200
PACKINGS, ENCRYPTED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED), 1
UNREADABLE = (
    *(ValueError, ArithmeticError, EOFError, OSError, MemoryError, RuntimeError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, tokenize.TokenError),
)
"""What numpy raises on an archive that is none, or that says too much."""
WIDTHS = {"fixes": 3, "poses": 4, "relations": 5, "landmarks": 3}
Mount = tuple[float, float, float]
NO_OFFSET = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class DataSetTruth:
    """Times are seconds of the run's stamps. None: the set does not have it.

    fixes (n, 3): t, x m, y m of the good GPS fixes. poses (n, 4): t, x m, y m, heading rad.
    pose_kind: what the poses are, in words. relations (n, 5): t1, t2 and the pose at t2 in the frame of that at t1.
    landmarks (n, 3): identity, x m, y m. of_body: the poses are those of the body; else of the laser, as fixes and
    relations always are.
    """

    fixes: FloatArray | None = None
    poses: FloatArray | None = None
    pose_kind: str = ""
    relations: FloatArray | None = None
    landmarks: FloatArray | None = None
    of_body: bool = False

    def point(self, body_from_laser: Mount) -> Mount:
        """Which point of the body the places are of."""
        return NO_OFFSET if self.fixes is None and self.of_body else body_from_laser

    def places_of_body(self, body_from_laser: Mount) -> FloatArray | None:
        """Rows (n, 4) of t s, x m, y m, heading rad of the body; None without places.

        Fixes tell no heading: theirs are 0, and the places remain those of the antenna.
        """
        if self.poses is None or self.fixes is not None:
            return None if self.fixes is None else np.column_stack((self.fixes, np.zeros(len(self.fixes))))
        body = composed(self.poses[:, 1:], inverted(np.array(self.point(body_from_laser))))
        return np.column_stack((self.poses[:, 0], body[:, :2], wrap_rads(body[:, 2])))

    def attachment(self) -> bytes:
        """As bytes; `from_attachment` gives it back."""
        arrays = {
            name: array
            for name in ("fixes", "poses", "relations", "landmarks")
            if (array := getattr(self, name)) is not None
        }
        stream = io.BytesIO()
        np.savez_compressed(stream, pose_kind=np.array(self.pose_kind), of_body=np.array(self.of_body), **arrays)
        return stream.getvalue()

    @classmethod
    def from_attachments(cls, attachments: Mapping[str, bytes]) -> "DataSetTruth | None":
        """The truth that a run holds, None when it holds none. Raises NotARunError where it is none."""
        data = attachments.get(ATTACHMENT)
        if data is None:
            return None
        try:
            arrays = _arrays(data)
            of_body = bool(arrays.pop("of_body", False))
            kind = printable(str(arrays.pop("pose_kind")), LONGEST_KIND)
            if any(array.ndim != 2 or array.shape[1] != WIDTHS[name] for name, array in arrays.items()):
                raise ValueError("an array of another shape")
            floats = {name: np.asarray(array, np.float64) for name, array in arrays.items()}
            return cls(pose_kind=kind, of_body=of_body, **floats)
        except (*UNREADABLE, KeyError, TypeError) as error:
            why = printable(str(error), 200)
            raise NotARunError(
                f"the run's {ATTACHMENT} is not usable as truth ({why}); import the data set again"
            ) from error


def _arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """Raises ValueError where they would take too much memory, and all that the reader of archives raises."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if any(each.compress_type not in PACKINGS or each.flag_bits & ENCRYPTED for each in archive.infolist()):
            raise ValueError("it was not packed by numpy")
        size = sum(each.file_size for each in archive.infolist())
        if size > LARGEST_BYTES:
            raise ValueError(f"it would unpack to {size} bytes, more than the {LARGEST_BYTES} that are allowed")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}
