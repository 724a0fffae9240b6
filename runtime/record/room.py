"""Room on the disk: the oldest segments that nobody marked go first, and the manifest says which and why."""

import contextlib
import errno
import fcntl
import os
from dataclasses import dataclass, field
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

    @property
    def drawn(self) -> Path:
        """The part of the review that goes with it."""
        return self.path.with_name("review" + self.path.stem.removeprefix("run") + ".rrd")

    @property
    def size(self) -> int:
        """Bytes on disk, 0 for what is gone."""
        return sum(path.stat().st_size for path in (self.path, self.drawn) if path.is_file())

    def remove(self, reason: str) -> None:
        """Say so in the manifest, then remove the files. Raises OSError."""
        self.manifest.add("removed", name=self.path.name, reason=reason)
        with contextlib.suppress(OSError):  # a full disk may have no room for the manifest either
            self.manifest.save()  # before the file goes: a loss of power between the two leaves more than was promised
        self.path.unlink()
        self.drawn.unlink(missing_ok=True)
        if not self.manifest.saved:
            self.manifest.save()


def is_being_written(path: Path) -> bool:
    """Whether a recorder of this machine has the file open; it locks what it writes. A file that is gone has none."""
    try:
        # without O_NONBLOCK a pipe would keep us
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False


@dataclass(slots=True)
class MadeRoom:
    """removed: which segments went, a sentence each. trouble: what is wrong if nothing more can go, "" otherwise."""

    removed: list[str] = field(default_factory=list)
    trouble: str = ""


def make_room(folder: RunFolder, manifest: Manifest, settings: RecordSettings, is_full: bool) -> MadeRoom:
    """Remove what the settings do not allow to stay, at most what is necessary, and nothing where it would not help.

    folder, manifest: of the run that is being recorded. is_full: the disk has just refused; then one segment goes in
    any case. Raises OSError.
    """
    made = MadeRoom()
    if not folder.path.is_dir():
        return made  # the disk is gone, and whoever writes says so
    if not (settings.budget_gb or is_full or _missing_bytes(folder, settings) > 0):
        return made  # other runs are many files: they are looked at only when there is a reason
    others = _other_runs(folder) if settings.budget_gb or settings.remove_older_runs else []
    runs = (folder, *(run for run, _ in others))
    used = sum(path.stat().st_size for run in runs for path in (*run.segment_paths(), *run.review_paths()))
    if not (is_full or _excess(folder, settings, used)):
        return made
    candidates = _closed(folder, manifest)
    candidates += [old for run in others for old in _closed(*run)]
    candidates.sort(key=lambda old: (old.manifest is manifest, old.age_ns), reverse=True)  # the last one goes first
    possible = sum(old.size for old in candidates)
    while reason := _excess(folder, settings, used) or ("the disk was full" if is_full else ""):
        if not candidates:
            made.trouble = f"{reason}, and there is no unmarked segment to remove"
            break
        over_budget = settings.budget_gb and used > settings.budget_gb * BYTES_PER_GB
        if not (over_budget or is_full) and possible < _missing_bytes(folder, settings):
            made.trouble = f"{reason}, which the {possible / BYTES_PER_GB:.2f} GB of unmarked segments would not reach"
            break
        old = candidates.pop()
        size = old.size
        try:
            old.remove(f"removed for room: {reason}")
        except OSError as error:
            made.trouble = f"{old.path} cannot be removed ({error.strerror})"
            break
        used, possible, is_full = used - size, possible - size, False
        made.removed.append(f"{old.path.parent.name}/{old.path.name} removed for room: {reason}")
    return made


def _missing_bytes(folder: RunFolder, settings: RecordSettings) -> float:
    """How much more of the disk would have to be free."""
    disk = os.statvfs(folder.path)
    return settings.keep_free_gb * BYTES_PER_GB - disk.f_bavail * disk.f_frsize


def _excess(folder: RunFolder, settings: RecordSettings, used: int) -> str:
    if settings.budget_gb and used > settings.budget_gb * BYTES_PER_GB:
        return f"runs take {used / BYTES_PER_GB:.2f} GB, record.budget_gb allows {settings.budget_gb:g}"
    missing = _missing_bytes(folder, settings)
    if missing > 0:
        free_gb = settings.keep_free_gb - missing / BYTES_PER_GB
        return f"{free_gb:.2f} GB are free, record.keep_free_gb asks for {settings.keep_free_gb:g}"
    return ""


def _closed(folder: RunFolder, manifest: Manifest) -> list[OldSegment]:
    """Segments of a run that may go: not marked, not being written, and none where a mark waits to be read."""
    if folder.marks_path.is_dir() and any(folder.marks_path.iterdir()):
        return []
    paths = folder.segment_paths()
    marked = manifest.marked(path.name for path in paths)
    return [
        OldSegment(path.stat().st_mtime_ns, path, manifest)
        for path in paths
        if path.name not in marked and not is_being_written(path)
    ]


def _other_runs(folder: RunFolder) -> list[tuple[RunFolder, Manifest]]:
    """Recorded runs beside this one; imports and replays have no manifest and are left alone, and so are links."""
    runs = []
    for path in sorted(folder.path.parent.iterdir()):
        other = RunFolder(path)
        if path != folder.path and not path.is_symlink() and other.manifest_path.is_file():
            manifest = Manifest.load(other.manifest_path)
            if not manifest.damage:  # a manifest that is damaged is evidence
                runs.append((other, manifest))
    return runs
