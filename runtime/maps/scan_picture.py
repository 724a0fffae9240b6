"""What the laser saw, laid where the published pose had it: one picture beneath the map."""

import io
from base64 import b64encode
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from drivers.measurements import FloatArray

CELL_M = 0.1
HALF = 1 << 20  # cells to each side of the origin: 100 km
MOST_PIXELS = 2000  # of a side; a place that is larger has larger cells
MERGED_AT = 100_000  # points that wait before cells are counted, for which sorting takes six times their memory
APART_NS = 500_000_000  # between two scans that count
SHADE = (123, 135, 146)  # seen on white and on black
SEEN_WELL = 4  # scans that saw a cell until it is drawn in full
FAINTEST = 90  # of 255: a cell that was seen at all


@dataclass(frozen=True, slots=True)
class ScanPicture:
    """A PNG as a data URL, its lower left corner and its size in the map frame."""

    url: str
    x_m: float
    y_m: float
    width_m: float
    height_m: float


class ScanCells:
    """Counts how many scans saw something in each cell of the map."""

    def __init__(self) -> None:
        self._waiting: list[NDArray[np.int64]] = []
        self._size = 0
        self._cells = np.empty(0, dtype=np.int64)
        self._counts = np.empty(0, dtype=np.int64)
        self._last_ns: int | None = None

    def wants(self, stamp_ns: int) -> bool:
        """Whether enough time has gone by since the last scan that was taken."""
        return self._last_ns is None or stamp_ns - self._last_ns >= APART_NS

    def take(self, stamp_ns: int, points_m: FloatArray) -> None:
        """Points (n, 2) of one scan in the map frame."""
        self._last_ns = stamp_ns
        column, row = np.floor(points_m.T / CELL_M).astype(np.int64) + HALF
        self._waiting.append(np.unique(column * 2 * HALF + row))
        self._size += len(self._waiting[-1])
        if self._size > MERGED_AT:
            self._merge()

    def picture(self) -> ScanPicture | None:
        """None where no scan was taken."""
        self._merge()
        if not self._counts.size:
            return None
        cells = np.stack((self._cells // (2 * HALF), self._cells % (2 * HALF)), axis=-1) - HALF
        low, high = cells.min(axis=0), cells.max(axis=0)
        factor = int(-(-(int((high - low).max()) + 1) // MOST_PIXELS))
        places = (cells - low) // factor
        columns, rows = places.max(axis=0) + 1
        pixels, index = np.unique((rows - 1 - places[:, 1]) * columns + places[:, 0], return_inverse=True)
        seen = np.zeros((rows, columns), dtype=np.uint8)
        seen.flat[pixels] = np.bincount(index, self._counts).clip(max=SEEN_WELL)
        picture = Image.fromarray(seen, mode="P")
        picture.putpalette(SHADE * (SEEN_WELL + 1))
        opacity = (0, *(max(FAINTEST, 255 * scans // SEEN_WELL) for scans in range(1, SEEN_WELL + 1)))
        file = io.BytesIO()
        picture.save(file, format="PNG", transparency=bytes(opacity))
        url = "data:image/png;base64," + b64encode(file.getvalue()).decode("ascii")
        size = CELL_M * factor
        x_m, y_m = (low * CELL_M).tolist()
        return ScanPicture(url, x_m, y_m, float(columns * size), float(rows * size))

    def _merge(self) -> None:
        if not self._waiting:
            return
        cells = np.concatenate([self._cells, *self._waiting])
        counts = np.concatenate([self._counts, np.ones(self._size, dtype=np.int64)])
        self._cells, index = np.unique(cells, return_inverse=True)
        self._counts = np.bincount(index, counts, len(self._cells)).astype(np.int64)
        self._waiting, self._size = [], 0
