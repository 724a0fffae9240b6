"""Opens files that others may have left: only regular ones, and small ones only up to so many bytes."""

import errno
import os
import stat
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

NOT_REGULAR = "not a regular file"


def open_regular(path: Path) -> BinaryIO:
    """A file to read, which keeps nobody waiting. Raises OSError: a folder (EISDIR), a pipe or a device (EINVAL).

    One that says of itself that it is empty is taken at its word: files of the kernel do, and some of them never end.
    """
    stream = open(path, "rb", opener=lambda *_: _opened(path))  # noqa: SIM115 whoever asked closes it
    if os.fstat(stream.fileno()).st_size:
        return stream
    stream.close()
    return BytesIO()


def read_bounded(path: Path, most_bytes: int, follow: bool = True) -> bytes:
    """The content of a file. follow: whether `path` itself may be a link.

    Raises OSError: a folder (EISDIR), a pipe or a device (EINVAL), a link (ELOOP), or more than most_bytes (EFBIG).
    """
    with open(_opened(path, 0 if follow else os.O_NOFOLLOW), "rb") as stream:
        is_too_large = os.fstat(stream.fileno()).st_size > most_bytes
        content: bytes | None = b"" if is_too_large else stream.read(most_bytes + 1)
    if content is None:  # a file of the kernel that waits for more, as others would wait for it
        raise OSError(errno.EINVAL, NOT_REGULAR, str(path))
    if is_too_large or len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"more than the {most_bytes} bytes that are allowed", str(path))
    return content


def _opened(path: Path, flags: int = 0) -> int:
    """Descriptor of a regular file. Raises OSError for anything else."""
    # without O_NONBLOCK a pipe that nobody writes to would keep us for ever
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | flags)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)  # here, because open() refuses a folder and leaves its descriptor open
        number = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(number, NOT_REGULAR, str(path))
    return descriptor
