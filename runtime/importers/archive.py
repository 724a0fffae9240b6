"""A recorded data set as one .npz archive with a description in it (format ld2d-1)."""

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.errors import DataSetError


@dataclass(frozen=True, slots=True)
class Archive:
    """Arrays by name; those that a set does not have are absent. meta: its description.

    laser_latency_s: taken off the stamps of what was seen.
    """

    name: str
    path: Path
    arrays: dict[str, NDArray[Any]]
    meta: dict[str, Any]
    laser_latency_s: float = 0.0

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    @property
    def start_s(self) -> float:
        """Earliest time of anything in the set, in its own seconds: zero of the run's stamps."""
        firsts = [
            float(self.arrays[name][0]) - self._late_s(name)
            for name in ("scan_t", "odom_t", "obs_t", "gt_t")
            if name in self.arrays and self.arrays[name].size
        ]
        return min(firsts)

    def stamps_ns(self, name: str) -> list[int]:
        """Times of an array as nanoseconds since the set's start; those of scans and sightings without latency."""
        offsets_s = self.arrays[name].astype(np.float64) - self._late_s(name) - self.start_s
        stamps: list[int] = np.round(offsets_s * 1e9).astype(np.int64).tolist()
        return stamps

    def _late_s(self, name: str) -> float:
        return self.laser_latency_s if name in ("scan_t", "obs_t") else 0.0


def load_archive(source: Path) -> Archive:
    """Read FOLDER/FOLDER.npz, or the .npz itself.

    Raises DataSetError with one sentence when it is not there, not an archive, or lacks a description.
    """
    path = source / f"{source.name}.npz" if source.is_dir() else source
    if not path.is_file():
        raise DataSetError(f"{source} holds no {path.name}; give the folder of a data set, or its .npz file")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(str(arrays.pop("meta")))
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise DataSetError(f"{path} cannot be read as a data set ({error}); fetch it again") from error
    except KeyError as error:
        raise DataSetError(f"{path} has no array named meta; it must describe the sensor (format ld2d-1)") from error
    return Archive(str(meta.get("name", path.stem)), path, arrays, meta)
