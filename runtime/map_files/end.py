"""What becomes of a map when the run that began in it ends: a successor, or the proof that it is as it was."""

import hashlib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import NotAMapError, StorageError
from runtime.map_files.map_file import MapFacts, SavedMap, encode_map
from runtime.map_files.map_store import write_new_map, write_successor
from runtime.map_files.start import RunStart
from runtime.record.folder import RunFolder
from runtime.settings.configuration import Configuration
from slam.kernel_cache import sources_hash
from slam.maps.joint_map import JointMap


def facts_of(configuration: Configuration, runs: tuple[str, ...], before: SavedMap | None = None) -> MapFacts:
    """The origin of a map that is written now; before: the map that its last drive began in."""
    facts = MapFacts(
        created_utc=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        configuration_text=configuration.text,
        runs=runs,
        rover=configuration.rover,
        slam_sources=sources_hash(),
    )
    if before is None:
        return facts
    known = before.facts
    facts = replace(facts, runs=(*known.runs, *runs), predecessor=before.sha256)
    return replace(facts, frame=known.frame, origin=known.origin)


def end_in_map(joint: JointMap, start: RunStart, configuration: Configuration, folder: RunFolder) -> dict[str, Any]:
    """For the summary of a run; nothing here raises, because the run has ended well.

    joint: what the filter has at the end. Where the successor cannot be written beside the map, it goes into the run.
    """
    facts: dict[str, Any] = {
        "file": str(start.path),
        "localise_only": start.localise_only,
        "landmarks": len(start.saved.joint),
        "sha256_before": start.saved.sha256,
        "sha256_after": sha256_of(start.path),
        "successor": None,
        "trouble": None,
    }
    if start.localise_only:
        return facts
    if added_nothing(joint, start):
        facts["trouble"] = "the run added nothing to the map: its place in the map was never recognised"
        return facts
    runs = (folder.path.resolve().name,)
    try:
        data = encode_map(joint, facts_of(configuration, runs, start.saved))
    except NotAMapError as error:
        facts["trouble"] = f"no map was written: {error}"
        return facts
    facts["landmarks_after"] = len(joint)
    try:
        facts["successor"] = str(write_successor(start.path, data))
    except StorageError as error:
        facts["trouble"] = str(error)
        try:
            write_new_map(folder.grown_map_path, data)
            facts["successor"] = str(folder.grown_map_path)
        except StorageError as second:
            facts["trouble"] = f"{error}; {second}"
    return facts


def added_nothing(joint: JointMap, start: RunStart) -> bool:
    """Whether a run ended with the map that it began in, since it never found its place there."""
    return all(np.array_equal(array, joint.arrays[name]) for name, array in start.saved.joint.arrays.items())


def sha256_of(path: Path) -> str | None:
    """Of a file as it is now, hexadecimal; None where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def end_lines(facts: dict[str, Any]) -> list[str]:
    """The same for a person."""
    same = facts["sha256_before"] == facts["sha256_after"]
    state = "unaltered" if same else "CHANGED BY ANOTHER PROGRAM DURING THE RUN"
    lines = [f"map       {facts['file']} is {state}: sha256 {facts['sha256_before'][:16]} before and after"]
    if not same:
        lines = [f"map       {facts['file']} was {state}"]
    if facts["successor"] is not None:
        grown = f"{facts['landmarks']} landmarks before, {facts['landmarks_after']} after"
        lines.append(f"map       extended into {facts['successor']}: {grown}")
    if facts["trouble"] is not None:
        lines.append(f"note      {facts['trouble']}")
    return lines
