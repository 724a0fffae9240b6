"""Room on the disk: the oldest segments that nobody marked go first, and the manifest says which and why."""

import contextlib
import errno
import fcntl
import os
from dataclasses import dataclass
from pathlib import Path

from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.settings.record import RecordSettings

FULL = frozenset((errno.ENOSPC, errno.EDQUOT))
BYTES_PER_GB = 1e9


@dataclass(frozen=True, slots=True)
class OldSegment:
    """A closed segment that may go, and the manifest that has to say so."""

    age_ns: int
    path: Path
    manifest: Manifest


def is_being_written(path: Path) -> bool:
    """Whether a recorder of this machine has the file open; it locks what it writes."""
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def make_room(folder: RunFolder, manifest: Manifest, settings: RecordSettings, is_full: bool) -> str:
    """Remove what the settings do not allow to stay, at most what is necessary.

    folder, manifest: of the run that is being recorded. is_full: the disk has just refused; then one segment goes in
    any case. Returns what is wrong if nothing more can go, "" otherwise. Raises OSError.
    """
    if not folder.path.is_dir():
        return ""  # the disk is gone, and whoever writes says so
    others = _other_runs(folder) if settings.budget_gb else []
    candidates = _closed(folder, manifest) + [old for run in others for old in _closed(*run)]
    candidates.sort(key=lambda old: old.age_ns, reverse=True)  # the oldest is popped first
    runs = (folder, *(run for run, _ in others))
    used = sum(path.stat().st_size for run in runs for path in (*run.segment_paths(), *run.review_paths()))
    while True:
        reason = _excess(folder, settings, used) or ("the disk was full" if is_full else "")
        if not reason:
            return ""
        if not candidates:
            return f"{reason}, and there is no unmarked segment to remove"
        old = candidates.pop()
        drawn = old.path.with_name("review" + old.path.stem.removeprefix("run") + ".rrd")
        used -= old.path.stat().st_size
        is_full = False
        old.manifest.add("removed", name=old.path.name, reason=f"removed for room: {reason}")
        with contextlib.suppress(OSError):  # a full disk may have no room for the manifest either
            old.manifest.save()  # before the file goes: a loss of power between the two leaves more than was promised
        old.path.unlink()
        if drawn.is_file():
            used -= drawn.stat().st_size
            drawn.unlink()
        if not old.manifest.saved:
            old.manifest.save()


def _excess(folder: RunFolder, settings: RecordSettings, used: int) -> str:
    if settings.budget_gb and used > settings.budget_gb * BYTES_PER_GB:
        return f"runs take {used / BYTES_PER_GB:.2f} GB, record.budget_gb allows {settings.budget_gb:g}"
    disk = os.statvfs(folder.path)
    free = disk.f_bavail * disk.f_frsize
    if free < settings.keep_free_gb * BYTES_PER_GB:
        return f"{free / BYTES_PER_GB:.2f} GB are free, record.keep_free_gb asks for {settings.keep_free_gb:g}"
    return ""


def _closed(folder: RunFolder, manifest: Manifest) -> list[OldSegment]:
    """Segments of a run that may go: not marked, not being written, and none where a mark waits to be read."""
    waits = folder.marks_path.is_dir() and any(folder.marks_path.iterdir())
    return [
        OldSegment(path.stat().st_mtime_ns, path, manifest)
        for path in folder.segment_paths()
        if not waits and not manifest.is_marked(path.name) and not is_being_written(path)
    ]


def _other_runs(folder: RunFolder) -> list[tuple[RunFolder, Manifest]]:
    """Recorded runs beside this one; imports and replays have no manifest and are left alone."""
    runs = []
    for path in sorted(folder.path.parent.iterdir()):
        other = RunFolder(path)
        if path != folder.path and other.manifest_path.is_file():
            manifest = Manifest.load(other.manifest_path)
            if not manifest.damage:  # a manifest that is damaged is evidence
                runs.append((other, manifest))
    return runs
