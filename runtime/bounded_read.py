"""Reads small files that others may have left: only regular ones, only so many bytes, and no link where none may be."""

import errno
import os
import stat
from pathlib import Path


def read_bounded(path: Path, most_bytes: int, follow: bool = True) -> bytes:
    """The content of a file. follow: whether `path` itself may be a link.

    Raises OSError: a folder (EISDIR), a pipe or a device (EINVAL), a link (ELOOP), or more than most_bytes (EFBIG).
    """
    # without O_NONBLOCK a pipe that nobody writes to would keep us for ever
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | (0 if follow else os.O_NOFOLLOW)
    descriptor = os.open(path, flags)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)  # here, because open() refuses a folder and leaves its descriptor open
        number = errno.EISDIR if stat.S_ISDIR(status.st_mode) else errno.EINVAL
        raise OSError(number, "not a regular file", str(path))
    with open(descriptor, "rb") as stream:
        if status.st_size > most_bytes or len(content := stream.read(most_bytes + 1)) > most_bytes:
            raise OSError(errno.EFBIG, f"more than the {most_bytes} bytes that are allowed", str(path))
    return content
