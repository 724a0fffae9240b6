"""Where compiled kernels are kept: one folder for each state of the sources of slam, readable by nobody but its owner.

numba notices a change only in the file of a kernel itself, not in what that kernel calls, so a cache shared between
versions runs old machine code. And its index files are pickles: whoever can write them runs code as us.
"""

import atexit
import contextlib
import grp
import hashlib
import os
import pwd
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, MutableMapping
from pathlib import Path

SOURCES = Path(__file__).parent
VARIABLE = "NUMBA_CACHE_DIR"
UNUSED_S = 30 * 24 * 3600.0  # after which nobody is thought to come back to a version


def use_compile_cache(environment: MutableMapping[str, str]) -> Path:
    """Choose the folder, make it, and name it in the environment, where child processes find it.

    Tried in this order: what NUMBA_CACHE_DIR names, systemd's CACHE_DIRECTORY, XDG_CACHE_HOME, ~/.cache. A folder that
    somebody else owns or may write to is passed over. Where none is left, the kernels are compiled into a new
    temporary folder that goes with this process.
    """
    for base in _bases(environment):
        folder = base if base.name == sources_hash() else base / "kernels" / sources_hash()
        if _made_private(folder) and os.access(folder, os.W_OK):
            break
    else:
        folder = Path(tempfile.mkdtemp(prefix="infant-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    environment[VARIABLE] = str(folder)
    with contextlib.suppress(OSError):
        os.utime(folder)  # in use
    return folder


def is_kept(folder: Path) -> bool:
    """Whether the folder outlives this process."""
    return folder.parent.name == "kernels"


def forget_other_versions(folder: Path) -> None:
    """Remove what was compiled from other sources and was not used for a month before this folder was: other checkouts
    of the same user have theirs beside it.
    """
    if folder.name == sources_hash() and is_kept(folder):
        used_s = folder.stat().st_mtime
        for other in folder.parent.iterdir():
            if used_s - other.lstat().st_mtime > UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)


def sources_hash() -> str:
    """Names the state of all files that kernels are made of; two replays only agree where this does."""
    return hash_of_files(SOURCES, SOURCES.rglob("*.py"))


def hash_of_files(root: Path, files: Iterable[Path]) -> str:
    """Sixteen hexadecimal digits over the content of the files and their paths relative to `root`."""
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _bases(environment: MutableMapping[str, str]) -> Iterator[Path]:
    if environment.get(VARIABLE):
        yield Path(environment[VARIABLE])
    if environment.get("CACHE_DIRECTORY"):
        yield Path(environment["CACHE_DIRECTORY"])
    yield Path(environment.get("XDG_CACHE_HOME") or Path(environment.get("HOME", "/")) / ".cache") / "infant"


def _made_private(folder: Path) -> bool:
    """Make the folder; False where it, or one above it, could be exchanged by another user than root or ourselves."""
    try:
        for missing in reversed([each for each in (folder, *folder.parents) if not each.exists()]):
            missing.mkdir(mode=0o700, exist_ok=True)
        return all(_is_private(each, folder) for each in (folder, *folder.absolute().parents))
    except OSError:
        return False


def _is_private(path: Path, folder: Path) -> bool:
    """Whether only we and root can change the entries of `path`; above `folder` a sticky bit is enough."""
    status = path.lstat() if path == folder else path.stat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid not in (0, os.geteuid()):
        return False
    if path != folder and status.st_mode & stat.S_ISVTX:
        return True
    others = stat.S_IWOTH if _has_no_other_member(status.st_gid) else stat.S_IWOTH | stat.S_IWGRP
    return not status.st_mode & others


def _has_no_other_member(group_id: int) -> bool:
    """Whether a group is the private one that Debian and Ubuntu give every user, in which umask 002 is usual."""
    try:
        group, user = grp.getgrgid(group_id), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}
