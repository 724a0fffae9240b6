"""What a data set saw: scans of a laser, or sightings of coded landmarks."""

from collections.abc import Iterator

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike, Sightings, uniform_bearings
from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.parsing.checks import BEAMS, WITHIN, number

UNKNOWN = -1  # identity of what the sensor saw and could not name
OTHER_ROBOTS = range(1, 6)  # MRCLAM: identities 1 to 5 are the other robots, which drive about


def seen(archive: Archive) -> Iterator[ScanLike]:
    """Scans or sightings in the order of their stamps. Raises DataSetError when the set has neither."""
    if "scan_t" in archive:
        return _scans(archive)
    if "obs_t" in archive:
        return _sightings(archive)
    if archive.raw is not None:  # a capture of the wheels' bus
        return iter(())
    raise DataSetError(f"{archive.path} has neither scans (scan_t) nor observations (obs_t); nothing was written")


def no_return_m(archive: Archive) -> float:
    """Range from which on a value means that nothing came back. Raises DataSetError for a word that says none."""
    said = str(archive.meta.get("no_return", ""))
    if not said.startswith(">="):
        return float(archive.meta["range_max"])
    try:
        told_m = float(said.removeprefix(">=").strip().removesuffix("m"))
    except ValueError as error:
        raise DataSetError(f"{archive.path}: meta.no_return = {said!r}, expected something like '>=80 m'") from error
    return number(archive.path, "no_return", told_m, *WITHIN["range_max"])


def _scans(archive: Archive) -> Iterator[Scan]:
    """Scans with beams counter-clockwise, whichever way round the laser turned; each with its own if they vary."""
    limit_m = no_return_m(archive)
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinitely far
        ranges = archive["ranges"].astype(np.float32)
    least_m, beam_period_s = (float(archive.meta.get(name, 0.0)) for name in ("range_min", "time_increment"))
    firsts, steps, counts = _beams(archive)
    bearings: dict[tuple[float, float, int], FloatArray] = {}
    rows = zip(archive.stamps_ns("scan_t"), ranges, firsts, steps, counts, strict=True)
    for stamp_ns, row, first_rad, step_rad, count in rows:
        valid = (row > least_m) & (row < np.float32(limit_m))  # false for NaN
        ranges_m = np.where(valid, row, np.float32(np.nan))[:count]
        period_s, stamp_beam = beam_period_s, 0
        if step_rad < 0.0:  # a clockwise laser: the same beams the other way round, the last of them taken first
            first_rad, step_rad, ranges_m = first_rad + (count - 1) * step_rad, -step_rad, ranges_m[::-1].copy()
            period_s, stamp_beam = -period_s, count - 1
        key = (first_rad, step_rad, count)
        if key not in bearings:
            bearings[key] = uniform_bearings(*key)
        yield Scan(stamp_ns, ranges_m, bearings[key], period_s, stamp_beam, limit_m)


def _beams(archive: Archive) -> tuple[list[float], list[float], list[int]]:
    """Bearing of the first beam rad, step rad and number of beams of each scan."""
    count, width = archive["ranges"].shape
    if BEAMS[0] in archive:
        firsts, steps, counts = (archive[name].tolist() for name in BEAMS)
        return firsts, steps, counts
    meta = archive.meta
    return [float(meta["angle_min"])] * count, [float(meta["angle_increment"])] * count, [width] * count


def _sightings(archive: Archive) -> Iterator[Sightings]:
    """Observations of one instant are one value; those of other robots are left out: they are no landmarks."""
    known = "obs_id" in archive
    identities = archive["obs_id"].astype(np.int64) if known else np.full(len(archive["obs_t"]), UNKNOWN)
    stamps_ns = np.array(archive.stamps_ns("obs_t"))
    kept = np.flatnonzero(~np.isin(identities, OTHER_ROBOTS))
    kept = kept[np.argsort(stamps_ns[kept], kind="stable")]
    instants_ns, firsts = np.unique(stamps_ns[kept], return_index=True)
    for stamp_ns, first, end in zip(instants_ns, firsts, [*firsts[1:], len(kept)], strict=True):
        rows = kept[first:end]
        ranges_m = archive["obs_range"][rows].astype(np.float64)
        bearings_rad = archive["obs_bearing"][rows].astype(np.float64)
        yield Sightings(int(stamp_ns), ranges_m, bearings_rad, identities[rows])
