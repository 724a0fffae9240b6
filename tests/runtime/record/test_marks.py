"""Whoever may write into a run's folder may mark; what he leaves there cannot keep the recorder from its work."""

import os
import time
from pathlib import Path

import pytest

from runtime.errors import StorageError
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.marks import LONGEST_REASON, MOST_MARKS, leave_mark, take_marks
from runtime.record.segments import MOST_MARKS as KEPT_MARKS
from runtime.record.writing.storage import SYNC_NS, Storage
from runtime.settings.record import RecordSettings
from tests.runtime.record.test_segments import SEGMENT_TICKS, Drive, driven


def test_what_is_no_small_file_is_a_mark_without_words(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    folder.marks_path.mkdir()
    (tmp_path / "secret").write_text("the key")
    (folder.marks_path / "a.txt").symlink_to(tmp_path / "secret")
    os.mkfifo(folder.marks_path / "b.txt")
    (folder.marks_path / "c.txt").mkdir()
    (folder.marks_path / "d.txt").write_text("x" * 100_000)
    (folder.marks_path / "e.txt").write_text("\x1b[2J a branch\nFAKE")
    marks = {path.name: reason for path, reason in take_marks(folder).items()}
    assert all(marks[f"{name}.txt"].startswith("a mark that cannot be read") for name in "abcd")
    assert marks["e.txt"] == "\\x1b[2J a branch\\nFAKE"
    assert "key" not in "".join(marks.values())


def test_a_mark_whose_file_stays_keeps_no_other_and_is_kept_once(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "run", tmp_path)
    header = RunHeader.of_live_run("", {})
    storage = Storage(run, header, RecordSettings(), time.monotonic_ns, lambda _number, _stamp_ns: None)
    run.marks_path.mkdir()
    (run.marks_path / "0.txt").mkdir()
    for number in range(2 * MOST_MARKS):
        (run.marks_path / f"{number + 1}.txt").write_text(f"branch {number}")
        storage.visit_disk(time.monotonic_ns() + (number + 1) * SYNC_NS)
    assert [path.name for path in run.marks_path.iterdir()] == ["0.txt"]
    assert "0.txt: a mark was kept and its file cannot be removed" in "; ".join(storage.troubles)
    storage.close()
    reasons = [mark["reason"] for mark in Manifest.load(run.manifest_path).marks]
    assert sorted(reasons[1:]) == sorted(f"branch {number}" for number in range(2 * MOST_MARKS))


def test_marks_behind_a_link_are_neither_read_nor_left(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(3)
    (tmp_path / "victim").mkdir()
    drive.folder.marks_path.symlink_to(tmp_path / "victim")
    with pytest.raises(OSError, match="it is a link"):
        take_marks(drive.folder)
    with pytest.raises(StorageError, match="it is a link"):
        leave_mark(drive.folder, "a branch", within_s=0.0)
    assert list((tmp_path / "victim").iterdir()) == []


def test_a_reason_is_kept_as_one_printable_line(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    assert leave_mark(folder, "b\udce4d \x1b[2J\n")
    assert [mark["reason"] for mark in Manifest.load(folder.manifest_path).marks] == ["b\\udce4d \\x1b[2J"]


def test_a_manifest_of_the_longest_marks_is_read_again(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    assert leave_mark(folder, "\U0001f333" * LONGEST_REASON)
    assert Manifest.load(folder.manifest_path).damage == ""


def test_a_flood_of_marks_keeps_what_it_marks_and_the_manifest_small(tmp_path: Path) -> None:
    """Whoever may command could leave 100 a second: after some minutes the manifest was larger than it may be."""
    drive = Drive(tmp_path / "run")
    drive.run(SEGMENT_TICKS // 2)
    for number in range(20 * KEPT_MARKS):
        drive.segments.mark(f"\U0001f333 {number}")
        if number % 100 == 0:
            drive.run(1)
    drive.run(4 * SEGMENT_TICKS)
    folder = drive.end()
    manifest = Manifest.load(folder.manifest_path)
    assert manifest.damage == ""
    assert KEPT_MARKS <= len(manifest.marks) < KEPT_MARKS + 20
    names = [path.name for path in folder.segment_paths()]
    assert manifest.marked(names[:11]) == set(names[:11])
