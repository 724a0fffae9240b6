"""What a recorded run holds, whether it is what was written, and how what is left of it is saved."""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runtime.bounded_read import open_regular, read_bounded
from runtime.errors import NotARunError
from runtime.messages.definitions import TYPES
from runtime.messages.tick import Record
from runtime.record.folder import LARGEST_MAP_BYTES, RunFolder
from runtime.record.manifest import Manifest
from runtime.record.mcap_file import RunWriter
from runtime.record.mcap_prefix import MAGIC
from runtime.record.reader import RunReader
from runtime.record.room import is_being_written

BLOCK_BYTES = 1 << 20


@dataclass(slots=True)
class Verification:
    """damages: what is not as it was written. gaps: what the record itself says it lacks."""

    ticks: int = 0
    segments: int = 0
    damages: list[str] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)


def run_info(run: Path) -> dict[str, Any]:
    """Header, segments and marks, without reading the segments. Raises NotARunError."""
    reader = RunReader(run)
    folder, header = reader.folder, reader.header
    manifest = Manifest.load(folder.manifest_path)
    segments: list[dict[str, Any]] = []
    paths, closed = folder.segment_paths(), manifest.segments
    marked = manifest.marked(path.name for path in paths)
    for path in paths:
        facts = closed.get(path.name, {})
        segments.append(
            {
                "name": path.name,
                "state": _state(path, bool(facts) or not manifest.lines),
                "bytes": path.stat().st_size,
                "ticks": facts.get("ticks"),
                "from_s": facts["first_ns"] * 1e-9 if facts else None,
                "to_s": facts["last_ns"] * 1e-9 if facts else None,
                "marked": path.name in marked,
            }
        )
    return {
        "run": str(folder.path),
        "source": header.source,
        "created_utc": header.created_utc,
        "boot_id": header.boot_id,
        "wall_minus_monotonic_ns": header.wall_minus_monotonic_ns,
        "configuration_sha256": header.configuration_sha256,
        "versions": dict(header.versions),
        "bytes": sum(segment["bytes"] for segment in segments),
        "segments": segments,
        "gone": manifest.removed,
        "marks": [mark["reason"] for mark in manifest.marks],
        "manifest": "none" if not manifest.lines and not manifest.damage else manifest.damage or "whole",
    }


def verify_run(run: Path) -> Verification:
    """Read every byte of a run. Raises NotARunError only where there is nothing that could be a run."""
    folder = RunFolder.open(run)
    manifest = Manifest.load(folder.manifest_path)
    found = Verification(segments=len(folder.segment_paths()), damages=alterations(folder, manifest))
    try:
        reader = RunReader(run, tolerant=True)
    except NotARunError as error:
        found.damages.append(str(error))
        return found
    found.ticks = sum(1 for _ in reader.ticks())
    found.damages += _together(folder.foreign_segments(), "no run has so many segments")
    found.damages += reader.damages
    found.gaps += reader.known_losses + [
        f"{gap.ticks} ticks and {gap.raw} raw messages before {gap.stamp_ns * 1e-9:.3f} s: {gap.reason}"
        for gap in reader.gaps
    ]
    return found


def alterations(folder: RunFolder, manifest: Manifest) -> list[str]:
    """What is not as it was closed: a sentence on the manifest, and on each file that it does not know like this."""
    found = [manifest.damage] if manifest.damage else []
    segments, unclosed = manifest.segments, list[str]()
    for path in folder.segment_paths():
        facts = segments.get(path.name)
        if facts is not None and not _is_as_closed(path, facts):
            found.append(f"{path.name} is not as it was when it was closed: its hash in {manifest.path.name} differs")
        elif facts is None and manifest.lines and (path.name != "run.mcap" or _has_end(path)):
            unclosed.append(path.name)
    return found + _together(unclosed, f"not closed: not in {manifest.path.name}")


def _together(names: list[str], damage: str) -> list[str]:
    """One sentence, however many segments it holds for."""
    if not names:
        return []
    which = names[0] if len(names) == 1 else f"{len(names)} segments, {names[0]} to {names[-1]}"
    return [f"{which}: {damage}"]


def alterations_of(reader: RunReader) -> list[str]:
    """What of a run that has just been read is not as it was closed; a run that was killed is what it is."""
    damages = reader.damages[:-1] if reader.cut_off else reader.damages
    closed = alterations(reader.folder, Manifest.load(reader.folder.manifest_path))
    return list(dict.fromkeys([*closed, *damages]))


def recover_run(run: Path, out: RunFolder) -> dict[str, Any]:
    """Write all that can be believed into a run of its own, with gaps where something is missing.

    Topics that this release does not know are carried over as they are. The damaged run is not touched.
    Raises NotARunError, StorageError.
    """
    reader = RunReader(run, tolerant=True)
    out.write_configuration(reader.header.configuration_text)
    losses = _take_along_start_map(reader.folder, out)
    writer = RunWriter(out.mcap_path, reader.header.metadata, reader.attachments)
    ticks = 0
    try:
        for records in _by_tick(reader.records()):
            writer.add(records, {name: channel for name, channel in reader.channels.items() if name not in TYPES})
            ticks += any(record.topic == "/tick" for record in records)
    finally:
        writer.close()
    losses += reader.damages + reader.known_losses
    return {"run": str(run), "out": str(out.path), "ticks": ticks, "losses": losses}


def _take_along_start_map(folder: RunFolder, out: RunFolder) -> list[str]:
    """Copy the map that the run began in, without which no replay begins; what was lost. Raises StorageError."""
    try:
        out.write(out.start_map_path, read_bounded(folder.start_map_path, LARGEST_MAP_BYTES, follow=False))
    except FileNotFoundError:
        return []  # it began without one
    except OSError as error:
        return [f"{folder.start_map_path.name} cannot be read ({error.strerror}): no replay can start in it"]
    return []


def _by_tick(records: Iterator[Record]) -> Iterator[list[Record]]:
    """Records in groups of which none parts a tick."""
    group: list[Record] = []
    has_tick = False
    for record in records:
        if has_tick and record.topic in ("/scan", "/tick"):
            yield group
            group, has_tick = [], False
        group.append(record)
        has_tick |= record.topic == "/tick"
    yield group


def _state(path: Path, may_be_closed: bool) -> str:
    return "open" if is_being_written(path) else "closed" if may_be_closed and _has_end(path) else "not closed"


def _has_end(path: Path) -> bool:
    """Whether the file was finished."""
    with open_regular(path) as stream:
        stream.seek(max(0, stream.seek(0, os.SEEK_END) - len(MAGIC)))
        return stream.read() == MAGIC


def _is_as_closed(path: Path, facts: dict[str, Any]) -> bool:
    """Whether a segment has the size and the hash that it was closed with; one of another size is not read for that."""
    try:
        has_size = path.stat().st_size == facts["bytes"]
    except OSError:
        return False
    return has_size and _sha256(path) == (facts["sha256"], facts["bytes"])


def _sha256(path: Path) -> tuple[str, int]:
    digest, size = hashlib.sha256(), 0
    try:
        with open_regular(path) as stream:
            most = os.stat(path).st_size + 1  # who writes as fast as we read would keep us for ever
            while block := stream.read(min(BLOCK_BYTES, most - size)):
                digest.update(block)
                size += len(block)
    except OSError as error:
        return f"unreadable: {error.strerror}", size
    return digest.hexdigest(), size
