"""Damage of any byte of a run is reported, nothing altered is returned, and the rest can be saved."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import NotARunError
from runtime.messages.recorded_tick import RecordedTick
from runtime.record.check import alterations_of, recover_run, run_info, verify_run
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from tests.runtime.record.test_segments import SEGMENT_TICKS, Drive, driven, is_part, seqs

PAGE_BYTES = 4096
Spoil = Callable[[bytearray, int, np.random.Generator], None]


def flip(content: bytearray, at: int, rng: np.random.Generator) -> None:
    content[min(len(content) - 1, at + int(rng.integers(PAGE_BYTES)))] ^= 1 << int(rng.integers(8))


def zero(content: bytearray, at: int, rng: np.random.Generator) -> None:
    content[at : at + PAGE_BYTES] = bytes(len(content[at : at + PAGE_BYTES]))


def killed(path: Path) -> RunFolder:
    """Three closed segments and a fourth that was not closed; its checkpoints are all that protects it."""
    drive = Drive(path)
    drive.run(45)
    drive.segments.close()
    return drive.folder


def test_a_whole_run_is_whole(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    found = verify_run(folder.path)
    assert (found.damages, found.gaps, found.ticks, found.segments) == ([], [], 40, 4)


def test_info_tells_what_is_there(tmp_path: Path) -> None:
    facts = run_info(driven(tmp_path / "run").path)
    assert [segment["ticks"] for segment in facts["segments"]] == [12, 12, 12, 4]
    assert facts["manifest"] == "whole"
    assert facts["configuration_sha256"]


def test_a_run_that_was_cut_off_says_so_and_nothing_else(tmp_path: Path) -> None:
    found = verify_run(killed(tmp_path / "run").path)
    assert len(found.damages) == 1
    assert "cut off" in found.damages[0]


def test_a_run_that_is_being_recorded_is_read_up_to_now_and_not_called_damaged(tmp_path: Path) -> None:
    """The recorder closes two segments while the run is read, one of them under the reader's hands."""
    drive = Drive(tmp_path / "run")
    drive.run(2 * SEGMENT_TICKS + SEGMENT_TICKS // 2)
    reader = RunReader(drive.folder.path)
    read = []
    for recorded in reader.ticks():
        read.append(recorded.tick.seq)
        if len(read) in (SEGMENT_TICKS, 2 * SEGMENT_TICKS + 1):
            drive.run(SEGMENT_TICKS)
    assert read == list(range(read[-1] + 1))
    assert len(read) > 3 * SEGMENT_TICKS
    assert "the run is still being recorded" in reader.truncated
    assert (reader.gaps, reader.damages, alterations_of(reader)) == ([], [], [])
    found = verify_run(drive.folder.path)
    assert (found.damages, found.gaps) == ([], ["the run is still being recorded"])
    drive.end()


def test_the_files_of_a_run_without_a_manifest_are_closed_if_they_have_their_end(tmp_path: Path) -> None:
    for make, last in ((driven, "closed"), (killed, "not closed")):
        folder = make(tmp_path / make.__name__)
        folder.manifest_path.unlink()
        assert [each["state"] for each in run_info(folder.path)["segments"]] == ["closed"] * 3 + [last]


@pytest.mark.parametrize("make", [driven, killed])
@pytest.mark.parametrize("spoil", [flip, zero])
def test_a_damaged_page_is_reported_and_nothing_altered_is_returned(
    tmp_path: Path, make: Callable[[Path], RunFolder], spoil: Spoil
) -> None:
    check_damaged_pages(make(tmp_path / "run"), spoil, 40)


@pytest.mark.soak
@pytest.mark.parametrize("make", [driven, killed])
@pytest.mark.parametrize("spoil", [flip, zero])
def test_each_of_a_thousand_damaged_pages_is_reported(
    tmp_path: Path, make: Callable[[Path], RunFolder], spoil: Spoil
) -> None:
    check_damaged_pages(make(tmp_path / "run"), spoil, 250)


def check_damaged_pages(folder: RunFolder, spoil: Spoil, times: int) -> None:
    rng = np.random.default_rng(5)
    whole = list(RunReader(folder.path).ticks())
    before = verify_run(folder.path).damages
    paths = [*folder.segment_paths(), folder.manifest_path]
    for _ in range(times):
        path = paths[int(rng.integers(len(paths)))]
        path.chmod(0o644)
        content = path.read_bytes()
        spoilt = bytearray(content)
        at = int(rng.integers(len(content))) // PAGE_BYTES * PAGE_BYTES
        spoil(spoilt, at, rng)
        if spoilt == content:
            continue
        path.write_bytes(spoilt)
        assert verify_run(folder.path).damages != before, (path.name, at)
        assert is_part(believed(folder), whole), (path.name, at)
        path.write_bytes(content)
    assert verify_run(folder.path).damages == before


def believed(folder: RunFolder) -> list[RecordedTick]:
    try:
        return list(RunReader(folder.path).ticks())
    except NotARunError:
        return []


def test_a_missing_line_of_the_manifest_is_reported(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    lines = folder.manifest_path.read_bytes().splitlines(keepends=True)
    for index in range(len(lines)):
        folder.manifest_path.write_bytes(b"".join(lines[:index] + lines[index + 1 :]))
        assert verify_run(folder.path).damages, index


def test_what_can_be_believed_becomes_a_whole_run(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    whole = list(RunReader(folder.path).ticks())
    path = folder.closed_path(2)
    path.chmod(0o644)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    result = recover_run(folder.path, RunFolder.create(tmp_path / "saved", tmp_path))
    assert verify_run(tmp_path / "saved").damages == []
    saved = list(RunReader(tmp_path / "saved").ticks())
    assert is_part(saved, whole)
    assert result["ticks"] == len(saved) == len(believed(folder)) > 28
    assert sum(gap.ticks for tick in saved for gap in tick.gaps) == 40 - len(saved)
    assert "run-0002.mcap" in result["losses"][0]


def test_a_segment_with_another_name_is_reported(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    folder.closed_path(2).rename(folder.closed_path(7))
    assert verify_run(folder.path).damages
    assert seqs(RunReader(folder.path))
