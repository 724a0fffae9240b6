"""A replay proves something of a run only where the run is what was closed; one that was killed is what it is."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from runtime.record.check import alterations_of
from runtime.record.folder import RunFolder
from runtime.record.mcap_prefix import RECORD_HEAD, McapPrefix
from runtime.record.reader import RunReader
from tests.runtime.record.test_check import killed
from tests.runtime.record.test_segments import Drive, driven


def altered(folder: RunFolder) -> list[str]:
    reader = RunReader(folder.path)
    for _ in reader.ticks():
        pass
    return alterations_of(reader)


def spoil(path: Path, at: int, size: int = 64) -> None:
    path.chmod(0o644)
    content = bytearray(path.read_bytes())
    content[at : at + size] = bytes(byte ^ 255 for byte in content[at : at + size])
    path.write_bytes(content)


def test_a_whole_run_and_one_that_was_killed_are_as_they_were_left(tmp_path: Path) -> None:
    assert altered(driven(tmp_path / "whole")) == []
    folder = killed(tmp_path / "killed")
    assert altered(folder) == []
    content = folder.mcap_path.read_bytes()
    folder.mcap_path.write_bytes(content[:-7])  # within the last record
    assert altered(folder) == []


def test_changed_bytes_are_named_wherever_they_are(tmp_path: Path) -> None:
    for number, place in enumerate((0.3, 0.6, 0.99)):
        folder = driven(tmp_path / f"run{number}")
        spoil(folder.closed_path(2), int(place * folder.closed_path(2).stat().st_size))
        assert "run-0002.mcap is not as it was when it was closed" in altered(folder)[0]


def test_what_is_cut_off_or_gone_though_it_was_closed_is_named(tmp_path: Path) -> None:
    folder = driven(tmp_path / "cut")
    folder.mcap_path.chmod(0o644)
    folder.mcap_path.write_bytes(folder.mcap_path.read_bytes()[:-500])
    assert "run.mcap is not as it was when it was closed" in altered(folder)[0]
    folder = driven(tmp_path / "gone")
    folder.closed_path(2).unlink()
    assert "run-0002.mcap is missing" in altered(folder)[0]


def test_a_segment_that_claims_to_be_endless_is_named_without_reading_it(tmp_path: Path) -> None:
    folder = driven(tmp_path / "endless")
    folder.closed_path(2).chmod(0o644)
    os.truncate(folder.closed_path(2), 1 << 42)  # of nothing: it takes no room on the disk
    assert "run-0002.mcap is not as it was when it was closed" in altered(folder)[0]


def test_changed_bytes_of_a_run_that_was_killed_are_named(tmp_path: Path) -> None:
    folder = killed(tmp_path / "killed")
    spoil(folder.mcap_path, folder.mcap_path.stat().st_size // 2, 4)
    assert altered(folder)


def heads(content: bytes) -> Iterator[tuple[int, int]]:
    """Place and length of every record outside of chunks."""
    at = 8
    while at < len(content):
        _, length = RECORD_HEAD.unpack_from(content, at)
        yield at, length
        at += RECORD_HEAD.size + length


def flipped(path: Path, content: bytes, places: Iterable[int]) -> Iterator[tuple[bool, int]]:
    """For each bit of these places: whether its change is named as damage, and the ticks that can be read."""
    for place in places:
        for bit in range(8):
            changed = bytearray(content)
            changed[place] ^= 1 << bit
            path.write_bytes(changed)
            file = McapPrefix(path)
            ticks = sum(topic == "/tick" for topic, _, _ in file.messages())
            yield bool(file.damage) and not file.cut_off, ticks


def test_no_bit_of_a_head_and_of_a_checkpoint_ends_a_killed_run_before_its_end_unsaid(tmp_path: Path) -> None:
    """A length that was changed must not look like the torn end that a kill leaves."""
    drive = Drive(tmp_path / "run", 1 << 62)
    drive.run(9)
    drive.segments.close()
    path, content = drive.folder.mcap_path, drive.folder.mcap_path.read_bytes()
    records = list(heads(content))
    last = records[-1][0]
    places = [*(at + byte for at, _ in records[:-1] for byte in range(RECORD_HEAD.size)), *range(last, len(content))]
    assert all(is_named for is_named, _ in flipped(path, content, places))
    torn = content[: last + 4]  # the last chunk is there, its checkpoint is not
    found = list(flipped(path, torn, [place for place in places if place < len(torn)]))
    assert all(is_named or ticks == 9 for is_named, ticks in found)
