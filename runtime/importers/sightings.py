"""What a data set saw: scans of a laser, or sightings of coded landmarks."""

from collections.abc import Iterator

import numpy as np

from drivers.measurements import Scan, ScanLike, Sightings, uniform_bearings
from runtime.errors import DataSetError
from runtime.importers.archive import Archive

OTHER_ROBOTS = range(1, 6)  # MRCLAM: identities 1 to 5 are the other robots, which drive about


def seen(archive: Archive) -> Iterator[ScanLike]:
    """Scans or sightings in the order of their stamps. Raises DataSetError when the set has neither."""
    if "scan_t" in archive:
        return _scans(archive)
    if "obs_t" in archive:
        return _sightings(archive)
    raise DataSetError(f"{archive.path} has neither scans (scan_t) nor observations (obs_t); nothing was written")


def no_return_m(archive: Archive) -> float:
    """Range from which on a value means that nothing came back."""
    said = str(archive.meta.get("no_return", ""))
    if said.startswith(">="):
        return float(said.removeprefix(">=").removesuffix("m"))
    return float(archive.meta["range_max"])


def _scans(archive: Archive) -> Iterator[Scan]:
    ranges, limit_m = archive["ranges"], no_return_m(archive)
    bearings_rad = uniform_bearings(archive.meta["angle_min"], archive.meta["angle_increment"], ranges.shape[1])
    for stamp_ns, row in zip(archive.stamps_ns("scan_t"), ranges, strict=True):
        valid = (row > 0.0) & (row < np.float32(limit_m))  # false for NaN
        yield Scan(stamp_ns, np.where(valid, row, np.float32(np.nan)), bearings_rad, range_max_m=limit_m)


def _sightings(archive: Archive) -> Iterator[Sightings]:
    """Observations of one instant are one value; those of other robots are left out: they are no landmarks."""
    identities = archive["obs_id"].astype(np.int64)
    stamps_ns = np.array(archive.stamps_ns("obs_t"))
    kept = ~np.isin(identities, OTHER_ROBOTS)
    for stamp_ns in np.unique(stamps_ns[kept]):
        rows = kept & (stamps_ns == stamp_ns)
        ranges_m = archive["obs_range"][rows].astype(np.float64)
        bearings_rad = archive["obs_bearing"][rows].astype(np.float64)
        yield Sightings(int(stamp_ns), ranges_m, bearings_rad, identities[rows])
