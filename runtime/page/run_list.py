"""The recorded runs of a folder with their verdicts, as far as `infant review` has judged them."""

import json
import math
import os
import shutil
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from runtime.bounded_read import read_bounded
from runtime.printable import printable
from runtime.record.folder import RunFolder
from runtime.record.room import is_being_written

MOST_RUNS = 50
MOST_FILES = 1000  # of a run that are looked at for its size: segments of eight hours and more
FRESH_S = 2.0
LARGEST_REPORT = 4 << 20  # bytes


class RunList:
    """The list for everyone who asks: looked up by one of them, and anew when it is FRESH_S old."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._lock = threading.Lock()
        self._told: dict[str, Any] = {}
        self._looked_up_s = -math.inf

    def told(self) -> dict[str, Any]:
        """Runs and the room on their disk."""
        with self._lock:
            if time.monotonic() - self._looked_up_s > FRESH_S:
                self._told = {"runs": recorded_runs(self._root), "free_gb": free_gb(self._root)}
                self._looked_up_s = time.monotonic()
            return self._told


def recorded_runs(root: Path) -> list[dict[str, Any]]:
    """The newest first, at most MOST_RUNS; a folder that is no run is left out."""
    try:
        with os.scandir(root) as entries:
            names = sorted((entry.name for entry in entries if entry.is_dir()), reverse=True)
    except OSError:
        return []
    runs: list[dict[str, Any]] = []
    for name in names[: 4 * MOST_RUNS]:
        with suppress(OSError):  # removed, or closed to us, while it is looked at
            if (told := _told(RunFolder(root / name))) is not None:
                runs.append(told)
        if len(runs) == MOST_RUNS:
            break
    return runs


def free_gb(root: Path) -> float | None:
    """Room on the disk of a folder, None where there is no such folder."""
    try:
        return round(shutil.disk_usage(root).free / 1e9, 1)
    except OSError:
        return None


def _told(folder: RunFolder) -> dict[str, Any] | None:
    """One run; None where none of the first MOST_FILES in the folder is of a record."""
    size, is_all = folder.measured(MOST_FILES)
    if not folder.mcap_path.is_file() and size == 0:
        return None
    recording = folder.mcap_path.is_file() and is_being_written(folder.mcap_path)
    verdict = "recording" if recording else _verdict(folder.path / "report.json")
    mb = round(size / 1e6, 1)
    return {"name": printable(folder.path.name, 100), "mb": mb, "is_all": is_all, "verdict": verdict}


def _verdict(report: Path) -> str:
    """Of a report, "not reviewed" without one."""
    try:
        said = json.loads(read_bounded(report, LARGEST_REPORT))
        return printable(str(said["verdict"]), 300)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "not reviewed"
