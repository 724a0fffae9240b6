import os
from pathlib import Path

import pytest

from runtime.bounded_read import open_regular, read_bounded

KERNEL_LOG = Path("/proc/kmsg")


def test_a_file_of_just_so_many_bytes_is_read(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_bounded(tmp_path / "link", 5) == b"12345"


def test_what_is_no_small_file_is_refused_and_keeps_nobody_waiting(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"123456")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    refusals = {
        tmp_path / "file": "more than the 5 bytes",
        tmp_path / "pipe": "not a regular file",
        tmp_path: "not a regular file",
        Path("/dev/zero"): "not a regular file",
        Path("/proc/self/mountinfo"): "more than the 5 bytes",  # says of itself that it is empty
    }
    for path, why in refusals.items():
        with pytest.raises(OSError, match=why):
            read_bounded(path, 5)
    with pytest.raises(OSError, match="symbolic links"):
        read_bounded(tmp_path / "link", 10, follow=False)


def test_what_is_refused_leaves_no_descriptor_open(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    before = len(os.listdir("/proc/self/fd"))
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(OSError, match="not a regular file"):
            read_bounded(path, 5)
        with pytest.raises(OSError, match="not a regular file"):
            open_regular(path)
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_file_of_the_kernel_keeps_nobody_waiting() -> None:
    for path in (Path("/proc/self/mountinfo"), Path("/proc/kmsg")):
        if os.access(path, os.R_OK):
            with open_regular(path) as stream:
                assert stream.read() == b""


def test_a_file_whose_next_byte_is_still_to_come_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    with open(os.open(tmp_path / "pipe", os.O_RDWR | os.O_NONBLOCK), "rb"):
        monkeypatch.setattr("stat.S_ISREG", lambda _mode: True)  # as /proc/kmsg says
        with pytest.raises(OSError, match="not a regular file"):
            read_bounded(tmp_path / "pipe", 100)
