"""Scans of different lengths as one array: a few long ones among many short ones must not fill the memory."""

from collections.abc import Sequence

import numpy as np

from drivers.measurements import RangeArray
from runtime.errors import DataSetError

MOST_BEAMS = 1 << 15  # of one scan; a beam every hundredth of a degree
MOST_PADDING, FREE_CELLS = 8, 1 << 22  # cells for each beam that was measured; so many are free


def padded_ranges(scans: Sequence[Sequence[float] | RangeArray]) -> RangeArray:
    """Ranges in m, (scans, most beams), NaN behind the last beam of a scan. Raises DataSetError where nearly all would
    be NaN.
    """
    counts = [len(scan) for scan in scans]
    cells = len(counts) * max(counts)
    if cells > max(FREE_CELLS, MOST_PADDING * sum(counts)):
        raise DataSetError(
            f"its scans have {min(counts)} to {max(counts)} beams, {sum(counts) / len(counts):.0f} on average: not "
            "from one laser; remove the long ones"
        )
    ranges: RangeArray = np.full((len(scans), max(counts)), np.nan, np.float32)
    for row, scan in zip(ranges, scans, strict=True):
        row[: len(scan)] = scan
    return ranges
