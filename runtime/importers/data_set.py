"""`infant import`: a recorded data set becomes a run that replays and evaluates like any other."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.measurements import OdometryPose, ScanLike, WheelSample
from runtime.errors import DataSetError
from runtime.evaluate.truth import ATTACHMENT
from runtime.importers.archive import Archive
from runtime.importers.mount import merged_mount, mount_of
from runtime.importers.parsing.checks import number
from runtime.importers.parsing.left_out import MUCH
from runtime.importers.recognise import load
from runtime.importers.rosbag import Topics
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import motion_model, samples_at_rest, wheel_samples
from runtime.messages.records import input_records
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader, installed_versions
from runtime.record.mcap_file import RunWriter
from runtime.settings.configuration import Configuration, load_configuration
from runtime.settings.data_set import DataSetSettings
from runtime.source_tree import CONFIG
from slam.odometry.odometry import Odometry

FAMILIES = ("victoria_park", "minesparis", "intel_lab", "aces_austin", "sjursflat", "mrclam", "carmen")
BY_FORMAT = {
    "bag ": "carmen.toml",
    "scip ": "rover.toml",
    "candump ": "rover.toml",
    "wires ": "rover.toml",
}  # beginning of a name by its reader: what describes any of them
NEAREST = {
    "pose": "carmen.toml",
    "differential": "minesparis.toml",
    "steered": "victoria_park.toml",
    "speed_yaw_rate": "mrclam.toml",
}
FORMS = {
    "pose": "poses of a robot's own odometry",
    "differential": "counts of two wheels",
    "steered": "speed and steering angle",
    "speed_yaw_rate": "speed and yaw rate",
}
ANY_TOPICS = Topics()
FAST_SPACING_NS = 100_000_000
SAMPLES_AT_ONCE = 10_000  # of the odometry are judged: all of a million at once take 400 MB
SLOW_SPACING_NS = 50_000_000  # odometry that comes as poses is slow, and relations ask for poses within 50 ms


def import_data_set(
    source: Path, out: Path, config: Path | None = None, at_rest: bool = False, topics: Topics = ANY_TOPICS
) -> dict[str, Any]:
    """Write SOURCE as a new run OUT and return what was imported.

    Stamps are nanoseconds since the set's start, those of scans less data_set.laser_latency_s. The configuration that
    goes into the run is config/<family>.toml of this project unless another is given; a mount that the set knows and
    the configuration does not goes into it as well. at_rest: the sensor stood still, so no odometry is needed.
    topics: of a bag of ROS, where they cannot be found.

    Raises DataSetError, ConfigurationError, RunExistsError, StorageError; nothing is written unless the whole set can
    be read.
    """
    archive = load(source, topics, config)
    if not at_rest and archive.raw is None:
        motion_model(archive)  # refuses a set of no use before anything else about it
    configuration, notes = configured(archive, config, at_rest)
    archive.left_out.notes.extend(notes)
    settings = configuration.data_set or DataSetSettings()
    archive = replace(archive, laser_latency_s=settings.laser_latency_s)
    scans, wheels = _inputs(archive, configuration, at_rest)
    truth = truth_of(archive)
    wall_start_ns = _wall_start_ns(archive)
    folder = RunFolder.create(out, out.parent)
    header = RunHeader(
        configuration.text,
        f"import {archive.name}",
        installed_versions(),
        wall_minus_monotonic_ns=wall_start_ns,
        created_utc=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
    )
    spacing_ns = SLOW_SPACING_NS if wheels and isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    count = sightings = last_ns = 0
    with folder.whole_or_gone():
        folder.write_configuration(configuration.text)
        writer = RunWriter(folder.mcap_path, header.metadata, {ATTACHMENT: truth.attachment()} if truth else {})
        raw = archive.raw(round(archive.start_s * 1e9)) if archive.raw is not None else iter(())
        waiting = next(raw, None)
        for tick in ticks(scans, wheels, spacing_ns):
            while waiting is not None and waiting.stamp_ns <= tick.stamp_ns:
                writer.add([waiting])
                waiting = next(raw, None)
            writer.add(input_records(tick))
            count, sightings, last_ns = count + 1, sightings + (tick.scan is not None), tick.stamp_ns
        for record in itertools.chain(() if waiting is None else (waiting,), raw):
            writer.add([record])
        writer.close()
    told, warnings = archive.left_out.sentences({"scans": sightings, "odometry samples": len(wheels)})
    return {
        "run": str(folder.path),
        "source": archive.name,
        "ticks": count,
        "scans": sightings,
        "wheel_samples": len(wheels),
        "laser_latency_s": settings.laser_latency_s,
        "mount": configuration.slam.mount.model_dump(),
        "duration_s": round(last_ns * 1e-9, 3),
        "truth": archive.meta.get("gt_kind", "of a kind that the set does not name") if truth else None,
        "configuration_sha256": configuration.sha256,
        "notes": told,
        "warnings": warnings,
    }


def import_lines(result: dict[str, Any]) -> list[str]:
    """What was imported for a person: facts, then what was left out or decided, each with its word."""
    lines = [f"{key:12s} {value}" for key, value in result.items() if key not in ("notes", "warnings")]
    lines += [f"note         {note}" for note in result["notes"]]
    return lines + [f"warning      {warning}" for warning in result["warnings"]]


def configured(archive: Archive, config: Path | None, at_rest: bool = False) -> tuple[Configuration, list[str]]:
    """The configuration of a set with the mount that its description gives, and sentences about what was chosen.

    Raises ConfigurationError; DataSetError where none is known, or where it expects another kind of odometry.
    """
    path = config if config is not None else configuration_path(archive)
    configuration = load_configuration(path)
    if not at_rest and (archive.raw is None or "odom_t" in archive):
        _check_motion_model(archive, configuration, path)
    overrides, notes = merged_mount(mount_of(archive), configuration)
    if config is None and path.name in BY_FORMAT.values():
        notes.append(
            f"config/{path.name} is used; copy it and give it with --config where the robot needs other values"
        )
    return (load_configuration(path, overrides) if overrides else configuration), notes


def configuration_path(archive: Archive) -> Path:
    """The configuration of the family that a set belongs to. Raises DataSetError when there is none, and names the
    nearest.
    """
    for family in FAMILIES:
        path = CONFIG / f"{family}.toml"
        if archive.name.startswith(family) and path.is_file():
            return path
    for beginning, name in BY_FORMAT.items():
        if archive.name.startswith(beginning):
            return CONFIG / name
    try:
        model = motion_model(archive)
        nearest = f"its odometry is {FORMS[model]}, as in config/{NEAREST[model]}: give that, or a copy with its mount,"
    except DataSetError:
        nearest = "the closest is config/carmen.toml, made for any laser indoors: give that"
    raise DataSetError(
        f"{archive.path}: no configuration known for {archive.name!r} in {CONFIG}; {nearest} with --config"
    )


def _check_motion_model(archive: Archive, configuration: Configuration, path: Path) -> None:
    """Raises DataSetError where the estimator would refuse every sample of the wheels."""
    model, wanted = motion_model(archive), configuration.vehicle.motion_model
    if model != wanted:
        raise DataSetError(
            f"{archive.path}: its odometry is {FORMS[model]}, but vehicle.motion_model = {wanted!r} of "
            f"{path} expects {FORMS[wanted]}; set it to {model!r}, with the geometry that it needs, or "
            f"start from config/{NEAREST[model]}"
        )


def _inputs(
    archive: Archive, configuration: Configuration, at_rest: bool
) -> tuple[Iterator[ScanLike], list[WheelSample]]:
    """What the estimator will get. Raises DataSetError where that is nothing."""
    scans = seen(archive)
    first = next(scans, None)
    if first is None and archive.raw is None:
        raise DataSetError(f"{archive.path} holds no usable scan; nothing was written")
    seen_ns = sorted(archive.stamps_ns("obs_t" if "obs_t" in archive else "scan_t")) if first is not None else []
    if at_rest and seen_ns:
        if "odom_t" in archive:
            archive.left_out.notes.append("the odometry is not used, because --at-rest says that nothing moved")
        wheels = samples_at_rest(seen_ns, configuration.vehicle.motion_model)
    elif archive.raw is None or "odom_t" in archive:
        wheels = wheel_samples(archive, configuration.vehicle)
        _check_overlap(archive, seen_ns, wheels)
        _count_refused(archive, configuration, wheels)
    else:
        wheels = []
        if seen_ns:
            archive.left_out.warnings.append(
                "the capture holds scans and no wheel sample, so the estimator knows nothing about the motion; "
                "give --at-rest if it stood still all the time"
            )
    return itertools.chain(() if first is None else (first,), scans), wheels


def _check_overlap(archive: Archive, seen_ns: list[int], wheels: list[WheelSample]) -> None:
    """Raises DataSetError where nothing was seen while the wheels were measured: two clocks."""
    if seen_ns and len(wheels) > 1 and (wheels[-1].stamp_ns < seen_ns[0] or wheels[0].stamp_ns > seen_ns[-1]):
        times_s = [1e-9 * ns for ns in (seen_ns[0], seen_ns[-1], wheels[0].stamp_ns, wheels[-1].stamp_ns)]
        raise DataSetError(
            "{}: the scans span {:.1f} to {:.1f} s and the odometry {:.1f} to {:.1f} s after the start; "
            "they do not overlap, so both need stamps of one clock; nothing was written".format(archive.path, *times_s)
        )


def _count_refused(archive: Archive, configuration: Configuration, wheels: list[WheelSample]) -> None:
    """Say how many samples the estimator's dead reckoning will refuse, and which key decides it."""
    odometry = Odometry(configuration.slam.odometry)
    for first in range(0, len(wheels), SAMPLES_AT_ONCE):
        part = tuple(wheels[first : first + SAMPLES_AT_ONCE])
        odometry.add(part)
        odometry.take_until(part[-1].stamp_ns)
    vehicle = configuration.vehicle
    reasons = {
        "wheel_jumps": f"move faster than {vehicle.jump_speed_mps:.3g} m/s, 1.5 times vehicle.max_speed_mps = "
        f"{vehicle.max_speed_mps:g}; raise that key",
        "wheel_values": f"are faster than {vehicle.jump_speed_mps:.3g} m/s, 1.5 times vehicle.max_speed_mps = "
        f"{vehicle.max_speed_mps:g}, or are impossible for a vehicle; raise that key if they are right",
        "wheel_stamps": "have a stamp that is not later than the one before",
    }
    for kind, reason in reasons.items():
        if refused := odometry.refused[kind]:
            text = f"{refused} of {len(wheels)} odometry samples will be rejected by the estimator: they {reason}"
            told = archive.left_out.warnings if refused > MUCH * len(wheels) else archive.left_out.notes
            told.append(text)


def _wall_start_ns(archive: Archive) -> int | None:
    """Nanoseconds since 1970 at the set's start, where the set tells."""
    if "t0_unix" in archive.meta:
        return round((number(archive.path, "t0_unix", archive.meta["t0_unix"], 0.0) + archive.start_s) * 1e9)
    return round(archive.start_s * 1e9) if archive.start_s > 5e8 else None
