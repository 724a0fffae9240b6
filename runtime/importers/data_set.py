"""`infant import`: a recorded data set becomes a run that replays and evaluates like any other."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.measurements import OdometryPose
from runtime.errors import DataSetError
from runtime.evaluate.truth import ATTACHMENT
from runtime.importers.archive import Archive, load_archive
from runtime.importers.carmen import is_carmen, load_carmen
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.messages.records import input_records
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader, installed_versions
from runtime.record.mcap_file import RunWriter
from runtime.settings.configuration import load_configuration
from runtime.settings.data_set import DataSetSettings
from runtime.source_tree import CONFIG

FAMILIES = ("victoria_park", "minesparis", "intel_lab", "aces_austin", "sjursflat", "mrclam", "carmen")
FAST_SPACING_NS = 100_000_000
SLOW_SPACING_NS = 50_000_000  # odometry that comes as poses is slow, and relations ask for poses within 50 ms


def import_data_set(source: Path, out: Path, config: Path | None = None) -> dict[str, Any]:
    """Write SOURCE as a new run OUT and return what was imported.

    Stamps are nanoseconds since the set's start, those of scans less data_set.laser_latency_s. The configuration that
    goes into the run is config/<family>.toml of this project unless another is given. Raises DataSetError,
    ConfigurationError, RunExistsError, StorageError; nothing is written unless the whole set can be read.
    """
    archive = load_carmen(source) if is_carmen(source) else load_archive(source)
    wheels = wheel_samples(archive)  # refuses a set of no use before anything else about it
    configuration = load_configuration(config if config is not None else configuration_path(archive))
    settings = configuration.data_set or DataSetSettings()
    if settings.laser_latency_s:
        archive = replace(archive, laser_latency_s=settings.laser_latency_s)
        wheels = wheel_samples(archive)
    scans = seen(archive)
    truth = truth_of(archive)
    folder = RunFolder.create(out, out.parent)
    folder.write_configuration(configuration.text)
    header = RunHeader(
        configuration.text,
        f"import {archive.name}",
        installed_versions(),
        wall_minus_monotonic_ns=_wall_start_ns(archive),
        created_utc=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
    )
    writer = RunWriter(folder.mcap_path, header.metadata, {ATTACHMENT: truth.attachment()} if truth else {})
    spacing_ns = SLOW_SPACING_NS if isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    count = sightings = last_ns = 0
    for tick in ticks(scans, wheels, spacing_ns):
        writer.add(input_records(tick))
        count, sightings, last_ns = count + 1, sightings + (tick.scan is not None), tick.stamp_ns
    writer.close()
    return {
        "run": str(folder.path),
        "source": archive.name,
        "ticks": count,
        "scans": sightings,
        "wheel_samples": len(wheels),
        "laser_latency_s": settings.laser_latency_s,
        "duration_s": round(last_ns * 1e-9, 3),
        "truth": archive.meta.get("gt_kind") if truth else None,
        "configuration_sha256": configuration.sha256,
    }


def configuration_path(archive: Archive) -> Path:
    """The configuration of the family that a set belongs to. Raises DataSetError when there is none."""
    for family in FAMILIES:
        path = CONFIG / f"{family}.toml"
        if archive.name.startswith(family) and path.is_file():
            return path
    raise DataSetError(
        f"{archive.path}: no configuration known for {archive.name!r} in {CONFIG}; give one with --config"
    )


def _wall_start_ns(archive: Archive) -> int | None:
    """Nanoseconds since 1970 at the set's start, where the set tells."""
    if "t0_unix" in archive.meta:
        return round((float(archive.meta["t0_unix"]) + archive.start_s) * 1e9)
    return round(archive.start_s * 1e9) if archive.start_s > 5e8 else None
