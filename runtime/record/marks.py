"""Marks: what a person at the rover wants to keep. A mark is a small file in the run's folder `marks`.

The recorder takes it within a second, writes it into manifest and log, and removes the file. Whoever may write into
the run's folder may mark: no network and no port is involved.
"""

import os
import threading
from itertools import islice
from pathlib import Path
from uuid import uuid4

from runtime.atomic_write import atomic_write, refuse_link
from runtime.bounded_read import read_bounded
from runtime.errors import NotARunError, StorageError, UsageError
from runtime.printable import printable
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.record.room import is_being_written

ALWAYS_NS = 1 << 62
LONGEST_REASON = 1000
LONGEST_FILE = 4 * LONGEST_REASON  # bytes of as many characters in UTF-8
MOST_MARKS = 20  # taken in one round of the recorder; the others wait a second
POLL_S = 0.05


def running_run(root: Path) -> RunFolder:
    """The run that is being recorded in a folder of runs. Raises NotARunError when there is none."""
    found = [RunFolder(path.parent) for path in sorted(root.glob("*/run.mcap")) if is_being_written(path)]
    if not found:
        raise NotARunError(
            f"{root}: no run is being recorded in this folder; name one with --run, or their folder with --runs"
        )
    return max(found, key=lambda folder: folder.mcap_path.stat().st_ctime_ns)


def leave_mark(folder: RunFolder, reason: str, within_s: float = 3.0) -> bool:
    """Mark a run: what is being recorded now, or all of a run that has ended.

    Returns whether the recorder has taken it in time; if not, the mark lies there and keeps the run all the same.
    Raises UsageError, StorageError.
    """
    reason = printable(reason.strip(), LONGEST_FILE)
    if not reason or len(reason) > LONGEST_REASON:
        raise UsageError(f"reason: expected 1 to {LONGEST_REASON} characters, got {len(reason)}; say what you saw")
    try:
        if not is_being_written(folder.mcap_path):
            return _mark_ended(folder, reason)
        folder.marks_path.mkdir(exist_ok=True)
        refuse_link(folder.marks_path)
        path = folder.marks_path / f"{uuid4().hex}.txt"
        atomic_write(path, reason)
    except OSError as error:
        raise StorageError(f"{folder.path} cannot be marked ({error.strerror}); you need write permission") from error
    pause = threading.Event()
    for _ in range(round(within_s / POLL_S)):
        if not path.exists():
            return True
        pause.wait(POLL_S)
    return not path.exists()


def take_marks(folder: RunFolder) -> dict[Path, str]:
    """The reasons that wait, by file. Raises OSError."""
    if not folder.marks_path.is_dir():
        return {}
    refuse_link(folder.marks_path)
    marks = {}
    with os.scandir(folder.marks_path) as entries:  # no more of it than is needed: it may hold any number
        names = sorted(islice((entry.name for entry in entries if entry.name.endswith(".txt")), MOST_MARKS))
    for path in (folder.marks_path / name for name in names):
        try:
            content = read_bounded(path, LONGEST_FILE, follow=False)
        except FileNotFoundError:
            continue
        except OSError as error:  # a pipe, a link, a film: none is read, and none may keep the recorder from the others
            content = f"a mark that cannot be read ({error.strerror})".encode()
        marks[path] = printable(content.decode(errors="replace").strip(), LONGEST_REASON)
    return marks


def _mark_ended(folder: RunFolder, reason: str) -> bool:
    manifest = Manifest.load(folder.manifest_path)
    if manifest.damage:
        raise StorageError(f"{folder.path}: {manifest.damage}; copy the run to a safe place instead")
    manifest.add("mark", from_ns=-ALWAYS_NS, to_ns=ALWAYS_NS, reason=reason)
    manifest.save()
    return True
