"""Saved maps on disk: read whole, written whole, and never over another one."""

import errno
import os
import re
import secrets
from contextlib import suppress
from pathlib import Path

from runtime.atomic_write import FOLDER_FLAGS, atomic_write, sync_folder
from runtime.bounded_read import read_bounded
from runtime.errors import NotAMapError, RunExistsError, StorageError
from runtime.map_files.map_file import LEAST_LANDMARKS, SavedMap, decode_map
from runtime.record.folder import LARGEST_MAP_BYTES

NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS)  # of a file system without hard links, as on cards
NUMBERED = re.compile(r"(.*)-(\d+)")


def read_map(path: Path) -> tuple[SavedMap, bytes]:
    """A map that a pose can be found in, and the bytes of its file. Raises NotAMapError."""
    try:
        data = read_bounded(path, LARGEST_MAP_BYTES)
    except FileNotFoundError as error:
        raise NotAMapError(f"{path} does not exist; save a map with infant map save RUN --out {path}") from error
    except OSError as error:
        raise NotAMapError(f"{path} cannot be read ({error.strerror}); give the file of a map") from error
    saved = decode_map(data, str(path))
    if len(saved.joint) < LEAST_LANDMARKS:
        count = "one landmark" if len(saved.joint) else "no landmark"
        raise NotAMapError(f"{path} holds {count}: too little to find a pose in; save a map of a longer drive")
    return saved, data


def refuse_taken(path: Path) -> None:
    """Raises RunExistsError where something has this name."""
    if path.exists() or path.is_symlink():
        raise RunExistsError(f"{path} exists already; maps are never overwritten; give another name with --out")


def write_new_map(path: Path, data: bytes) -> None:
    """Make a file that is not there yet; where two write at once, one of them is refused.

    Raises RunExistsError where the name is taken, StorageError where the disk or the folder refuses.
    """
    hidden = path.with_name(f".{path.name}.{secrets.token_hex(8)}.new")
    try:
        refuse_taken(path)
        atomic_write(hidden, data)
        _give_name(hidden, path)
    except FileExistsError:
        refuse_taken(path)
        raise
    except OSError as error:
        raise StorageError(
            f"{path} cannot be written ({error.strerror}); free space, or give another folder"
        ) from error
    finally:
        with suppress(OSError):
            hidden.unlink()


def _give_name(hidden: Path, path: Path) -> None:
    """Raises FileExistsError where the name is taken, whoever took it; other OSErrors as they come."""
    try:
        os.link(hidden, path)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666))
        os.replace(hidden, path)
    folder = os.open(path.parent, FOLDER_FLAGS)
    try:
        sync_folder(folder)
    finally:
        os.close(folder)


def write_successor(path: Path, data: bytes) -> Path:
    """Write the map that has grown out of the one at `path` beside it: hall.map, hall-2.map, hall-3.map.

    Returns where it is; the first number that is free. Raises StorageError.
    """
    match = NUMBERED.fullmatch(path.stem)
    stem, number = (match[1], int(match[2])) if match else (path.stem, 1)
    while True:
        number += 1
        successor = path.with_name(f"{stem}-{number}{path.suffix}")
        if successor.exists():
            continue
        with suppress(RunExistsError):
            write_new_map(successor, data)
            return successor
