"""infant export: one pass over a run, out of which every form is written that was asked for."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from runtime.atomic_write import make_folder, take_away
from runtime.errors import RunExistsError, StorageError, UsageError
from runtime.export.grid import MOST_CELLS
from runtime.export.rosbag2 import Rosbag2
from runtime.export.tables import CsvFile, GeoJsonFile, TumFile
from runtime.map_files.start import origin_of
from runtime.messages.recorded_tick import RecordedTick
from runtime.record.reader import RunReader
from runtime.record.room import is_being_written
from runtime.record.trajectories import with_estimates
from runtime.settings.configuration import load_configuration_text
from slam.estimate import Estimate

TICKS_A_REPORT = 200


class Form(Protocol):
    """One form of a run, written tick by tick."""

    def add(self, recorded: RecordedTick, estimate: Estimate) -> None:
        """The next tick that has an estimate. Raises OSError."""

    def finish(self) -> None:
        """Make it whole. Raises OSError."""

    def close(self) -> None:
        """Release the file, whole or not."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where each form goes; None where it is not wanted."""

    ros2: Path | None = None
    csv: Path | None = None
    tum: Path | None = None
    geojson: Path | None = None

    @property
    def paths(self) -> dict[str, Path]:
        """Those that are wanted, by form."""
        named = {"ros2": self.ros2, "csv": self.csv, "tum": self.tum, "geojson": self.geojson}
        return {form: path for form, path in named.items() if path is not None}


def export_run(
    run: Path, outputs: Outputs, progress: Callable[[float], None], resolution_m: float | None = 0.1
) -> dict[str, Any]:
    """The command; returns its summary. resolution_m: of the grid on /map, None: no grid.

    Raises UsageError where nothing is asked for or there are no estimates, NotARunError, RunExistsError, StorageError.
    """
    if not outputs.paths:
        raise UsageError("nothing to write: give --ros2 DIR, --csv FILE, --tum FILE or --geojson FILE")
    for kind, path in outputs.paths.items():
        _refuse_existing(kind, path)
    began_s = time.monotonic()
    reader = with_estimates(RunReader(run))
    if is_being_written(reader.folder.mcap_path):
        raise UsageError(f"{run} is still being recorded; stop it first: infant command stop, or Ctrl-C at infant run")
    offset_ns = reader.header.wall_minus_monotonic_ns
    ticks, made = 0, list[Path]()
    try:
        with ExitStack() as opened:
            for kind, path in outputs.paths.items():
                made[:0] = make_folder(path if kind == "ros2" else path.parent)
            forms = _forms(reader, outputs, offset_ns or 0, resolution_m, opened)
            for recorded in reader.ticks():
                if (estimate := recorded.estimate) is None:
                    continue
                for form in forms.values():
                    form.add(recorded, estimate)
                ticks += 1
                if ticks % TICKS_A_REPORT == 0:
                    progress(reader.read_fraction)
            if ticks == 0:
                raise UsageError(f"{run} holds no estimates; make them with: infant replay {run} --out RUN")
            for form in forms.values():
                form.finish()
    except BaseException as error:
        _remove(outputs, made)
        if not isinstance(error, OSError):
            raise
        where = error.filename or ", ".join(map(str, outputs.paths.values()))
        raise StorageError(
            f"{where} cannot be written ({error.strerror}); the incomplete export was removed"
        ) from error
    progress(1.0)
    bag = forms.get("ros2")
    messages, has_part = (bag.messages, bag.has_part_of_map) if isinstance(bag, Rosbag2) else ({}, False)
    return {
        "run": str(run),
        "files": {form: str(path) for form, path in outputs.paths.items()},
        "ticks": ticks,
        "messages": messages,
        "part_of_map": has_part,
        "stamps": "UTC" if offset_ns is not None else "the recording's own clock",
        "truncated": reader.truncated or None,
        "seconds": round(time.monotonic() - began_s, 2),
    }


def _forms(
    reader: RunReader, outputs: Outputs, offset_ns: int, resolution_m: float | None, opened: ExitStack
) -> dict[str, Form]:
    configuration = load_configuration_text(reader.header.configuration_text, source=str(reader.folder.path))
    forms: dict[str, Form] = {}
    makers: dict[str, Callable[[Path], Form]] = {
        "ros2": lambda path: Rosbag2(path, configuration, offset_ns, resolution_m),
        "csv": lambda path: CsvFile(path, offset_ns),
        "tum": lambda path: TumFile(path, offset_ns),
        "geojson": lambda path: GeoJsonFile(path, offset_ns, origin_of(reader.header, reader.folder)),
    }
    for name, path in outputs.paths.items():
        forms[name] = makers[name](path)
        opened.callback(forms[name].close)
    return forms


def _refuse_existing(kind: str, path: Path) -> None:
    """A bag may go into an empty folder. Whatever is there else stays, and a link is not followed."""
    if kind == "ros2" and path.is_dir() and not path.is_symlink() and not any(path.iterdir()):
        return
    if path.exists() or path.is_symlink():
        raise RunExistsError(f"{path} exists; nothing is overwritten; give another name")


def _remove(outputs: Outputs, made: Sequence[Path]) -> None:
    """Half an export is none: all that is there is what this one has made."""
    for path in outputs.paths.values():
        with suppress(OSError):
            for each in path.iterdir() if path.is_dir() else (path,):
                each.unlink()
    take_away(made)


def export_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    lines = [f"{form:<9} {path}" for form, path in summary["files"].items()]
    if summary["messages"]:
        lines.append("topics    " + ", ".join(f"{topic} {count}" for topic, count in summary["messages"].items()))
    if summary["stamps"] != "UTC":
        lines.append(
            "note      the recording does not hold the time of day: its stamps are those of the recording clock"
        )
    if summary["part_of_map"]:
        lines.append(
            "note      /map has only the beginning of the drive: all of it takes more than "
            f"{MOST_CELLS / 1e6:.0f} million cells; give a coarser --resolution"
        )
    if summary["truncated"]:
        lines.append(f"note      {summary['truncated']}")
    return [*lines, f"ticks     {summary['ticks']} in {summary['seconds']:.1f} s"]
