"""Scans and wheel counts of other programs, as arrays, become the ticks that the estimator takes."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from drivers.measurements import Scan, WheelCounts, WheelSample
from runtime.errors import UsageError
from runtime.importers.ticks import ticks
from runtime.tick import Tick

SPACING_NS = 100_000_000  # of ticks without a scan, where scans are farther apart
MOST_STAMP_NS = 1 << 62


def ticks_from_arrays(
    scan_stamps_ns: ArrayLike,
    ranges_m: ArrayLike,
    bearings_rad: ArrayLike,
    wheel_stamps_ns: ArrayLike,
    wheel_counts: ArrayLike,
    beam_period_s: float = 0.0,
    range_max_m: float = 60.0,
) -> Iterator[Tick]:
    """One tick for each scan, with the wheel samples since the tick before. The arrays are copied.

    scan_stamps_ns (n,): time of the first beam, rising. ranges_m (n, b): NaN or inf where nothing came back.
    bearings_rad (b,): counter-clockwise, 0 ahead, in the laser's frame. wheel_stamps_ns (w,): rising, same clock.
    wheel_counts (w, 2): totals of the left and the right wheel, unwrapped, forward positive.
    beam_period_s: from one beam to the next. Raises UsageError where shapes or stamps do not fit.
    """
    scan_ns, wheel_ns = _stamps("scan_stamps_ns", scan_stamps_ns), _stamps("wheel_stamps_ns", wheel_stamps_ns)
    ranges = np.array(ranges_m, dtype=np.float32)
    bearings = np.array(bearings_rad, dtype=np.float64)
    counts = np.array(wheel_counts, dtype=np.float64)
    if ranges.shape != (len(scan_ns), bearings.size) or bearings.ndim != 1:
        raise UsageError(
            f"ranges_m has the shape {ranges.shape}; expected a row for each of {len(scan_ns)} scans and a column "
            f"for each of {bearings.size} bearings"
        )
    if counts.shape != (len(wheel_ns), 2):
        raise UsageError(f"wheel_counts has the shape {counts.shape}; expected ({len(wheel_ns)}, 2), left and right")
    if not (np.isfinite(bearings).all() and np.isfinite(counts).all()):
        raise UsageError("bearings_rad and wheel_counts must be finite; leave out samples that were not measured")
    ranges[~((ranges > 0.0) & (ranges <= range_max_m))] = np.nan
    scans = (
        Scan(stamp, row.copy(), bearings, beam_period_s, range_max_m=range_max_m)
        for stamp, row in zip(scan_ns, ranges, strict=True)
    )
    wheels: list[WheelSample] = [
        WheelCounts(stamp, left, right) for stamp, (left, right) in zip(wheel_ns, counts.tolist(), strict=True)
    ]
    return ticks(scans, wheels, SPACING_NS)


def _stamps(name: str, stamps: ArrayLike) -> Sequence[int]:
    """Integers of nanoseconds that rise. Raises UsageError."""
    array = np.asarray(stamps)
    if array.ndim != 1 or not np.issubdtype(array.dtype, np.integer):
        raise UsageError(
            f"{name} has the type {array.dtype} and shape {array.shape}; expected integers in ns, shape (n,)"
        )
    values: list[int] = array.tolist()
    if any(after <= before for before, after in pairwise(values)):
        raise UsageError(f"{name} must increase from each entry to the next; sort the samples and remove repeated ones")
    if any(not -MOST_STAMP_NS < value < MOST_STAMP_NS for value in values[:1] + values[-1:]):
        raise UsageError(f"{name} reaches beyond 2^62 ns; expected nanoseconds")
    return values
