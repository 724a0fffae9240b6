"""The recorded runs of a folder with their verdicts, as far as `infant review` has judged them."""

import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from runtime.bounded_read import read_bounded
from runtime.printable import printable
from runtime.record.folder import RunFolder
from runtime.record.room import is_being_written

MOST_RUNS = 50
LARGEST_REPORT = 4 << 20  # bytes


def recorded_runs(root: Path) -> list[dict[str, Any]]:
    """The newest first, at most MOST_RUNS; a folder that is no run is left out."""
    try:
        folders = sorted((path for path in root.iterdir() if path.is_dir()), key=lambda path: path.name, reverse=True)
    except OSError:
        return []
    runs: list[dict[str, Any]] = []
    for path in folders[: 4 * MOST_RUNS]:
        with suppress(OSError):  # removed, or closed to us, while it is looked at
            if RunFolder(path).segment_paths():
                runs.append(_told(RunFolder(path)))
        if len(runs) == MOST_RUNS:
            break
    return runs


def free_gb(root: Path) -> float | None:
    """Room on the disk of a folder, None where there is no such folder."""
    try:
        return round(shutil.disk_usage(root).free / 1e9, 1)
    except OSError:
        return None


def _told(folder: RunFolder) -> dict[str, Any]:
    sizes = [path.stat().st_size for path in folder.segment_paths()]
    recording = folder.mcap_path.is_file() and is_being_written(folder.mcap_path)
    verdict = "recording" if recording else _verdict(folder.path / "report.json")
    return {"name": printable(folder.path.name, 100), "mb": round(sum(sizes) / 1e6, 1), "verdict": verdict}


def _verdict(report: Path) -> str:
    """Of a report, "not reviewed" without one."""
    try:
        said = json.loads(read_bounded(report, LARGEST_REPORT))
        return printable(str(said["verdict"]), 300)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "not reviewed"
