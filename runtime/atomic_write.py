"""Replaces a file whole or not at all, safe against a loss of power and against links that somebody has planted."""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER_FLAGS = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
NEW_FILE_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


def atomic_write(path: Path, content: str | bytes, mode: int | None = None) -> None:
    """Write text (as UTF-8) or bytes to `path`; whoever reads it sees the old content or the new one.

    mode: permissions of the file; by default what the umask leaves of 0o666. Raises OSError, and then nothing is left.
    """
    data = content.encode() if isinstance(content, str) else content
    with _replacing(path) as (folder, name):
        descriptor = os.open(name, os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
        with open(descriptor, "wb") as stream:
            if mode is not None:
                os.fchmod(descriptor, mode)
            stream.write(data)


@contextmanager
def replacement(path: Path) -> Iterator[Path]:
    """An empty file beside `path`, for a library that writes by name; it takes the place of `path` when all went well.

    Raises OSError. Whatever is raised inside, the file is removed again and `path` stays as it was.
    """
    with _replacing(path) as (_, name):
        yield path.with_name(name)


@contextmanager
def _replacing(path: Path) -> Iterator[tuple[int, str]]:
    """Descriptor of the folder, and the name of a new file in it, which nobody can foresee."""
    folder = os.open(path.parent, FOLDER_FLAGS)
    name = f".{path.name}.{secrets.token_hex(8)}.unfinished"
    try:
        os.close(os.open(name, NEW_FILE_FLAGS, 0o666, dir_fd=folder))
        yield folder, name
        _sync_file(name, folder)
        os.replace(name, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        sync_folder(folder)
    except BaseException:
        with suppress(OSError):
            os.unlink(name, dir_fd=folder)
        raise
    finally:
        os.close(folder)


def _sync_file(name: str, folder: int) -> None:
    descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=folder)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_folder(folder: int) -> None:
    """Make sure that the names in a folder outlive a loss of power, where its file system can. Raises OSError."""
    try:
        os.fsync(folder)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
