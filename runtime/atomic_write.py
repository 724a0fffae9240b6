"""Replaces a file whole or not at all, safe against a loss of power and against links that somebody has planted.

Root who writes into a folder of another user does so with no more rights than that user has.
"""

import ctypes
import errno
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import takewhile
from pathlib import Path

from runtime.errors import UsageError

FOLDER_FLAGS = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
WRITE_FLAGS = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC
NEW_FILE_FLAGS = WRITE_FLAGS | os.O_CREAT | os.O_EXCL


def atomic_write(path: Path, content: str | bytes, mode: int | None = None) -> None:
    """Write text or bytes to `path`; whoever reads it sees the old content or the new one.

    Text is written as UTF-8; what cannot be, as in names of files, in escapes.
    mode: permissions of the file; by default what the umask leaves of 0o666. Raises OSError, and then nothing is left.
    """
    write_together({path: content}, mode)


def write_together(files: Mapping[Path, str | bytes], mode: int | None = None) -> None:
    """The same of several files: none takes its place before all of them could be written. Raises OSError."""
    with ExitStack() as stack:
        for path, content in files.items():
            data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
            folder, name = stack.enter_context(_replacing(path))
            with open(os.open(name, WRITE_FLAGS, dir_fd=folder), "wb") as stream:
                if mode is not None:
                    os.fchmod(stream.fileno(), mode)
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())


@contextmanager
def replacement(path: Path) -> Iterator[Path]:
    """An empty file beside `path`, for a library that writes by name; it takes the place of `path` when all went well.

    Raises OSError. Whatever is raised inside, the file is removed again and `path` stays as it was.
    """
    if _is_of_another(path.parent.stat()):  # the library's threads would follow links as root
        with tempfile.TemporaryDirectory() as private:
            unfinished = Path(private) / path.name
            yield unfinished
            with (
                unfinished.open("rb") as source,  # while we may still read it
                _replacing(path) as (folder, name),
                open(os.open(name, WRITE_FLAGS, dir_fd=folder), "wb") as target,
            ):
                shutil.copyfileobj(source, target)
                target.flush()
                os.fsync(target.fileno())
        return
    with _replacing(path) as (folder, name):
        beside = path.with_name(name)
        # libraries of other languages take names in UTF-8 only
        yield beside if str(beside).isascii() or _is_utf8(beside) else Path(f"/proc/self/fd/{folder}/{name}")
        _sync_file(name, folder)


def _is_utf8(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


@contextmanager
def acting_as_owner(folder: Path | int) -> Iterator[None]:
    """What this thread does to files inside, it does with the rights of the folder's owner where it is root.

    folder: one that exists, by name or descriptor. Raises OSError where those rights cannot be taken.
    """
    status = os.stat(folder)
    if not _is_of_another(status):
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    group, user = libc.setfsgid(status.st_gid), libc.setfsuid(status.st_uid)  # of this thread alone, unlike seteuid
    try:
        if libc.setfsuid(-1) != status.st_uid:
            why = f"root may not act as the owner, user {status.st_uid}; run the command as that user"
            raise PermissionError(errno.EPERM, why, str(folder))
        yield
    finally:
        libc.setfsuid(user)
        libc.setfsgid(group)


def _is_of_another(status: os.stat_result) -> bool:
    """Whether we are root, and this is not root's."""
    return os.geteuid() == 0 and status.st_uid != 0


@contextmanager
def _replacing(path: Path) -> Iterator[tuple[int, str]]:
    """Descriptor of the folder, and the name of a new file in it, which nobody can foresee; who writes it syncs it."""
    _refuse_device(path)
    folder = os.open(path.parent, FOLDER_FLAGS)
    name = f".{path.name}.{secrets.token_hex(8)}.unfinished"
    try:
        with acting_as_owner(folder):
            try:
                os.close(os.open(name, NEW_FILE_FLAGS, 0o666, dir_fd=folder))
                yield folder, name
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


def _refuse_device(path: Path) -> None:
    """Raises OSError where a file would take the place of what programs of all users write to, such as /dev/null."""
    with suppress(FileNotFoundError):
        is_link = path.is_symlink() and os.readlink(path).startswith(("/proc/", "/dev/"))
        if is_link or stat.S_IFMT(os.lstat(path).st_mode) not in (stat.S_IFREG, stat.S_IFLNK, stat.S_IFDIR):
            raise OSError(errno.EEXIST, "it is a device or a pipe, which no file may replace", str(path))


def beside(page: Path, suffix: str) -> Path:
    """A file of the same name as a page, with another suffix. Raises UsageError where it has no name for that."""
    if not page.name or page.suffix == suffix:
        raise UsageError(f"--out {page}: expected the name of an HTML file; give one, for example report.html")
    return page.with_suffix(suffix)


def make_folder(path: Path) -> tuple[Path, ...]:
    """Make a folder with those above that are missing; returns what was made, inmost first. Raises OSError."""
    missing = tuple(takewhile(lambda each: not each.is_dir(), (path, *path.absolute().parents)))
    if missing:
        with acting_as_owner(missing[-1].absolute().parent):
            path.mkdir(parents=True, exist_ok=True)
    return missing


def take_away(made: Sequence[Path]) -> None:
    """Remove folders that were just made, inmost first, where nothing is in them."""
    for folder in made:
        with suppress(OSError):
            folder.rmdir()


def refuse_link(path: Path) -> None:
    """Raises OSError where a folder of ours is a link: what is written through it would land in somebody else's."""
    if path.is_symlink():
        raise OSError(errno.ELOOP, "it is a link, and nothing is written through links", str(path))


def sync_folder(folder: int) -> None:
    """Make sure that the names in a folder outlive a loss of power, where its file system can. Raises OSError."""
    try:
        os.fsync(folder)
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
