"""The folder of a run: what it holds, how it is made, and that it is never overwritten."""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from runtime.atomic_write import atomic_write, make_folder, refuse_link, take_away
from runtime.errors import NotARunError, RunExistsError, StorageError
from runtime.printable import printable

LARGEST_MAP_BYTES = 64 << 20  # of a saved map with as much in it as runtime/map_files/map_file.py allows
MOST_SEGMENTS = 999_999  # of half a second each: five days; of a minute: two years
CLOSED_NAME = re.compile(r"run-([0-9]{4,6})\.mcap")
DIGITS = re.compile(r"run-\d+\.mcap")
CLOSED_REVIEW = re.compile(r"review-[0-9]{4,6}\.rrd")


@dataclass(frozen=True, slots=True)
class RunFolder:
    """One run on disk. `create` makes it, `open` finds it. made: folders that were not there before, inmost first."""

    path: Path
    made: tuple[Path, ...] = field(default=(), compare=False, repr=False)

    @classmethod
    def create(cls, out: Path | None, root: Path) -> "RunFolder":
        """Make `out`, or a new folder <utc>-<id> in `root`.

        Raises RunExistsError when `out` holds anything, StorageError when it cannot be made.
        """
        path = out if out is not None else root / new_name(datetime.now(UTC))
        try:
            refuse_link(path)
            made = make_folder(path)
            occupied = any(path.iterdir())
            path.chmod(path.stat().st_mode)  # a file system mounted read-only says so here and not a minute later
        except ValueError as error:
            raise StorageError(f"{printable(str(path))} is not a name for a folder ({error}); give another") from error
        except (FileExistsError, NotADirectoryError) as error:
            raise RunExistsError(f"{path} is a file; give the name of a new folder with --out") from error
        except OSError as error:
            raise StorageError(
                f"{path} cannot be created ({error.strerror}); give another folder with --out"
            ) from error
        if occupied:
            raise RunExistsError(
                f"{path} exists and is not empty; runs are never overwritten; give another name with --out"
            )
        return cls(path, made)

    @contextmanager
    def whole_or_gone(self) -> Iterator[None]:
        """Take the folder, just made, away again where a full disk, a defect or Ctrl-C leaves it half written."""
        try:
            yield
        except BaseException:
            self.remove()
            raise

    def remove(self) -> None:
        """Take what a folder holds, just made and of no use, away again; itself too where it was not there before."""
        with suppress(OSError), os.scandir(self.path) as entries:
            for entry in entries:
                with suppress(OSError):
                    shutil.rmtree(entry) if entry.is_dir(follow_symlinks=False) else os.unlink(entry)
        take_away(self.made)

    @classmethod
    def open(cls, path: Path) -> "RunFolder":
        """The run in a folder, or beside the run.mcap that is given. Raises NotARunError when there is none."""
        folder = path.parent if path.suffix == ".mcap" else path
        if not folder.is_dir():
            raise NotARunError(f"{path} does not exist; give the folder of a run")
        found = cls(folder)
        if not found.is_run:
            raise NotARunError(f"{path} is not a run: it has no run.mcap; give the folder of a run")
        return found

    @property
    def mcap_path(self) -> Path:
        """The record, what came in and what came of it: the whole of it, or its last segment."""
        return self.path / "run.mcap"

    def closed_path(self, number: int) -> Path:
        """A segment that is closed for good, counted from 1."""
        return self.path / self.closed_name(number)

    @staticmethod
    def closed_name(number: int) -> str:
        """Its name."""
        return f"run-{number:04d}.mcap"

    def closed_segments(self) -> dict[int, Path]:
        """Segments that are there beside run.mcap, by number, oldest first; a number that no run reaches is none."""
        found = {
            int(match[1]): name
            for name, is_file in self._entries()
            if (match := CLOSED_NAME.fullmatch(name)) and is_file()  # a pipe would keep whoever reads it
        }
        return {number: self.path / found[number] for number in sorted(found)}

    def measured(self, most: int) -> tuple[int, bool]:
        """Bytes of the record, and whether that is all of it: no more than so many names are looked at."""
        size, looked_at = 0, 0
        with os.scandir(self.path) as entries:
            for looked_at, entry in enumerate(entries, 1):
                if looked_at > most:
                    break
                if entry.name == "run.mcap" or CLOSED_NAME.fullmatch(entry.name):
                    size += entry.stat().st_size
        return size, looked_at <= most

    @property
    def is_run(self) -> bool:
        """Whether anything of a record is there."""
        if self.mcap_path.is_file():
            return True
        return any(CLOSED_NAME.fullmatch(name) and is_file() for name, is_file in self._entries())

    def foreign_segments(self) -> list[str]:
        """Whatever has the name of a segment that no run reaches, and what has that of a segment and is no file."""
        return sorted(
            name
            for name, is_file in self._entries()
            if DIGITS.fullmatch(name) and not (CLOSED_NAME.fullmatch(name) and is_file())
        )

    def _entries(self) -> Iterator[tuple[str, Callable[[], bool]]]:
        """Names of what lies in the folder, and whether each is a file, without asking the disk for each anew."""
        try:
            with os.scandir(self.path) as entries:
                for entry in entries:
                    yield entry.name, entry.is_file
        except (FileNotFoundError, NotADirectoryError):
            return  # as where nothing lies in it

    def segment_paths(self) -> list[Path]:
        """All files of the record that are there, oldest first."""
        last = [self.mcap_path] if self.mcap_path.is_file() else []
        return [*self.closed_segments().values(), *last]

    @property
    def manifest_path(self) -> Path:
        """What the segments have to be: sizes and hashes in a chain."""
        return self.path / "manifest.jsonl"

    @property
    def marks_path(self) -> Path:
        """Where `infant mark` leaves its reasons for the recorder."""
        return self.path / "marks"

    @property
    def map_path(self) -> Path:
        """The landmarks as they were when someone said save."""
        return self.path / "map.json"

    @property
    def start_map_path(self) -> Path:
        """A copy of the saved map that the run began in, where it began in one."""
        return self.path / "start.map"

    @property
    def grown_map_path(self) -> Path:
        """What the run made of that map, where it could not be written beside it."""
        return self.path / "grown.map"

    @property
    def review_path(self) -> Path:
        """The picture of the run; can be made again. Of a long run that was drawn live: its last part."""
        return self.path / "review.rrd"

    @staticmethod
    def closed_review_name(number: int) -> str:
        """The part of the review that was drawn while a segment was written."""
        return f"review-{number:04d}.rrd"

    def review_paths(self) -> list[Path]:
        """All files of the review that are there, oldest first; together they are one picture."""
        last = [self.review_path] if self.review_path.is_file() else []
        parts = [name for name, _ in self._entries() if CLOSED_REVIEW.fullmatch(name)]
        return [*(self.path / name for name in sorted(parts, key=lambda name: (len(name), name))), *last]

    @property
    def configuration_path(self) -> Path:
        """The configuration in force, a copy of the one inside the record."""
        return self.path / "config.toml"

    @property
    def summary_path(self) -> Path:
        """What the command line printed."""
        return self.path / "summary.json"

    def tum_path(self, name: str) -> Path:
        """A path in TUM form, for evo: "trajectory" (the published pose), "odometry" or "truth"."""
        return self.path / f"{name}.tum"

    @property
    def replays_path(self) -> Path:
        """Replays of a run that has no estimates of its own; each is a run folder itself."""
        return self.path / "replays"

    def new_replay(self, out: Path | None) -> "RunFolder":
        """Make `out`, or a new folder in replays/. Raises RunExistsError, StorageError."""
        if out is None:
            self._refuse_links([self.replays_path])
        return RunFolder.create(out, self.replays_path)

    def newest_replay(self) -> "RunFolder | None":
        """The finished replay inside this run that ended last. Raises StorageError where it lies behind a link."""
        summaries = sorted(self.replays_path.glob("*/summary.json"), key=lambda path: path.lstat().st_mtime_ns)
        if not summaries:
            return None
        self._refuse_links([self.replays_path, summaries[-1].parent])
        return RunFolder(summaries[-1].parent)

    def _refuse_links(self, paths: list[Path]) -> None:
        """Raises StorageError where one of these is a link, by which a run of others writes somewhere else."""
        try:
            for path in paths:
                refuse_link(path)
        except OSError as error:
            why = f"{error.filename} cannot be used ({error.strerror}); remove it, or name a folder with --out"
            raise StorageError(why) from error

    def write_configuration(self, text: str) -> None:
        """Keep the configuration in force. Raises StorageError."""
        self.write(self.configuration_path, text)

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Keep what the command line prints. Raises StorageError."""
        self.write(self.summary_path, json.dumps(summary, indent=2) + "\n")

    def write(self, path: Path, content: str | bytes) -> None:
        """Write a small file of the run whole or not at all. Raises StorageError."""
        try:
            atomic_write(path, content)
        except OSError as error:
            raise StorageError(f"{path} cannot be written ({error.strerror}); free space or check the mount") from error


def new_name(utc: datetime) -> str:
    """<utc>-<id>: names sort by time, and two runs of one second differ."""
    return f"{utc:%Y%m%dT%H%M%SZ}-{uuid4().hex[:6]}"
