"""infant map save: the map that a run has made, in a file of its own."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from runtime.errors import UsageError
from runtime.map_files.end import added_nothing, facts_of
from runtime.map_files.map_file import LEAST_LANDMARKS, encode_map
from runtime.map_files.map_store import refuse_taken, write_new_map
from runtime.map_files.origin import parse_origin
from runtime.map_files.start import for_estimator, recorded_start
from runtime.record.reader import RunReader
from runtime.replay.replay import replay
from runtime.settings.configuration import load_configuration_text
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings


def save_run(run: Path, out: Path, progress: Callable[[float], None], origin: str | None = None) -> dict[str, Any]:
    """The command: replay the run up to its end, and write the map that the filter has then. origin: where on earth
    it lies, LATITUDE,LONGITUDE[,HEADING]; else what the map that the run began in knows.

    Raises NotARunError, RunExistsError, StorageError, ConfigurationError, and UsageError where there is no map.
    """
    began_s = time.monotonic()
    refuse_taken(out)  # before the work and not only after it
    place = None if origin is None else parse_origin(origin)
    reader = RunReader(run)
    configuration = load_configuration_text(reader.header.configuration_text, source=f"configuration of {run}")
    start = recorded_start(reader.header, reader.folder)
    made: list[Estimator] = []

    def estimator(settings: SlamSettings, seed: int) -> Estimator:
        made.append(Estimator(settings, seed, start=for_estimator(start)))
        return made[-1]

    result = replay(reader, configuration, progress=progress, estimator_factory=estimator)
    joint = made[0].joint_map()
    if start is not None and added_nothing(joint, start):
        raise UsageError(
            f"{run} added nothing to the map that it started in: its place was never recognised; use {start.path}"
        )
    if len(joint) < LEAST_LANDMARKS:
        raise UsageError(f"{run} has {len(joint)} confirmed landmarks: too few to find a pose in; drive farther")
    facts = facts_of(configuration, (run.resolve().name,), None if start is None else start.saved)
    data = encode_map(joint, facts if place is None else replace(facts, origin=place))
    write_new_map(out, data)
    return {
        "run": str(run),
        "out": str(out),
        "landmarks": len(joint),
        "bytes": len(data),
        "defects": result.defects,
        "truncated": result.truncated or None,
        "seconds": round(time.monotonic() - began_s, 2),
    }


def save_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    lines = [f"map       {summary['out']}  {summary['landmarks']} landmarks, {summary['bytes'] / 1e3:.0f} kB"]
    if summary["truncated"]:
        lines.append(f"note      {summary['truncated']}")
    if summary["defects"]:
        lines.append(f"note      {summary['defects']} steps of the filter raised an error; their scans are left out")
    return lines
