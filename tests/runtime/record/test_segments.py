"""A long run is many closed segments that read as one; what is missing between them is said."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from runtime.messages.recorded_tick import RecordedTick
from runtime.messages.records import tick_records
from runtime.messages.tick import Record
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.mcap_prefix import McapPrefix
from runtime.record.reader import RunReader
from runtime.record.room import make_room
from runtime.record.segments import Segments
from runtime.settings.record import RecordSettings
from runtime.tick import CompletedTick
from tests.support.runtime.recorded_values import PERIOD_NS, make_estimate, make_tick, make_timing, same_bits

SEGMENT_TICKS = 10
CHUNK_TICKS = 3


def records_of(seq: int, rng: np.random.Generator, beams: int = 40) -> list[Record]:
    tick = make_tick(seq, rng, ("scan", "sightings", "nothing")[seq % 3], beams)
    return tick_records(
        CompletedTick(tick, make_estimate(tick.stamp_ns, rng, beams), make_timing(seq), bytes([seq] * 16), None)
    )


class Drive:
    """Segments on a clock that is moved by hand: one tick is a tenth of a second."""

    def __init__(self, path: Path, segment_ns: int = SEGMENT_TICKS * PERIOD_NS) -> None:
        self.now_ns = 0
        self.folder = RunFolder.create(path, path)
        metadata = RunHeader("seed = 1\n", "live", boot_id="b", created_utc="u").metadata
        self.segments = Segments(self.folder, metadata, segment_ns, lambda: self.now_ns)
        self.rng = np.random.default_rng(3)
        self.seq = 0

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            for record in records_of(self.seq, self.rng):
                self.segments.add(record)
            self.seq += 1
            self.now_ns += PERIOD_NS
            if self.seq % CHUNK_TICKS == 0:
                self.segments.end_chunk()
                self.segments.write()

    def end(self) -> RunFolder:
        self.segments.finish()
        self.segments.write()
        self.segments.close()
        return self.folder


def driven(path: Path, ticks: int = 40) -> RunFolder:
    drive = Drive(path)
    drive.run(ticks)
    return drive.end()


def seqs(reader: RunReader) -> list[int]:
    return [recorded.tick.seq for recorded in reader.ticks()]


def is_part(recorded: list[RecordedTick], of: list[RecordedTick]) -> bool:
    by_seq = {tick.tick.seq: tick for tick in of}
    return all(
        same_bits(tick.tick, by_seq[tick.tick.seq].tick) and tick.outcomes == by_seq[tick.tick.seq].outcomes
        for tick in recorded
    )


def test_segments_read_as_one_run(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    assert len(folder.closed_segments()) == 3
    reader = RunReader(folder.path)
    assert seqs(reader) == list(range(40))
    assert reader.truncated == ""
    assert reader.read_fraction == 1.0


def test_a_file_that_grows_while_it_is_read_is_read_as_it_was_found(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(3)
    prefix = McapPrefix(drive.folder.mcap_path)
    found_bytes = drive.folder.mcap_path.stat().st_size
    drive.run(3)
    assert sum(topic == "/tick" for topic, _, _ in prefix.messages()) == 3
    assert prefix.cut_off
    assert prefix.size == prefix.offset == found_bytes


def test_each_segment_is_a_run_by_itself(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    for number, path in folder.closed_segments().items():
        alone = RunFolder.create(tmp_path / str(number), tmp_path)
        alone.mcap_path.write_bytes(path.read_bytes())
        reader = RunReader(alone.path)
        assert reader.header.configuration_text == "seed = 1\n"
        assert len(seqs(reader)) == 12


def test_the_manifest_names_every_segment_with_its_hash(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    manifest = Manifest.load(folder.manifest_path)
    assert manifest.damage == ""
    assert sorted(manifest.segments) == ["run-0001.mcap", "run-0002.mcap", "run-0003.mcap", "run.mcap"]
    assert sum(facts["ticks"] for facts in manifest.segments.values()) == 40


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_segment_that_is_gone_is_a_gap_of_its_ticks(tmp_path: Path, number: int) -> None:
    folder = driven(tmp_path / "run")
    folder.closed_path(number).unlink()
    reader = RunReader(folder.path)
    left = seqs(reader)
    assert left == [seq for seq in range(40) if seq // 12 != number - 1]
    assert [gap.ticks for gap in reader.gaps] == [12]
    assert f"run-000{number}.mcap is missing" in reader.truncated


def test_a_link_in_place_of_the_folder_is_not_written_through(tmp_path: Path) -> None:
    drive, victim = Drive(tmp_path / "run"), tmp_path / "victim"
    drive.run(CHUNK_TICKS)
    victim.mkdir()
    (tmp_path / "run").rename(tmp_path / "old")
    (tmp_path / "run").symlink_to(victim)
    for _ in range(3):
        with pytest.raises(OSError, match=r"removed while being written|nothing is written through links"):
            drive.run(CHUNK_TICKS)
    assert not any(victim.iterdir())
    (tmp_path / "run").unlink()
    drive.run(CHUNK_TICKS)
    assert seqs(RunReader(drive.end().path))[-1] == drive.seq - 1


def test_a_last_segment_that_is_gone_is_said(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    folder.mcap_path.unlink()
    reader = RunReader(folder.path)
    assert seqs(reader) == list(range(36))
    assert "run.mcap is missing" in reader.truncated


def test_reading_goes_on_behind_a_damaged_segment(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    whole = list(RunReader(folder.path).ticks())
    path = folder.closed_path(2)
    path.chmod(0o644)
    spoilt = bytearray(path.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    path.write_bytes(spoilt)
    reader = RunReader(folder.path)
    recorded = list(reader.ticks())
    assert is_part(recorded, whole)
    assert recorded[-1].tick.seq == 39
    assert sum(gap.ticks for gap in reader.gaps) == 40 - len(recorded)
    assert "run-0002.mcap" in reader.truncated


def test_a_segment_of_another_run_is_not_read_as_part_of_this_one(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    other = RunFolder.create(tmp_path / "other", tmp_path)
    metadata = RunHeader("seed = 2\n", "live", boot_id="b", created_utc="u").metadata
    stranger = Segments(other, metadata, 1, lambda: 0)
    stranger.finish()
    stranger.write()
    folder.closed_path(2).unlink()
    folder.closed_path(2).write_bytes(other.mcap_path.read_bytes())
    reader = RunReader(folder.path)
    assert seqs(reader) == [seq for seq in range(40) if seq // 12 != 1]
    assert "another run" in reader.truncated


def test_a_file_taken_away_costs_what_was_in_it_and_nothing_that_comes_after(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    drive.folder.mcap_path.unlink()
    with pytest.raises(FileNotFoundError, match="removed"):
        drive.run(3)
    drive.run(22)
    folder = drive.end()
    reader = RunReader(folder.path)
    left = seqs(reader)
    assert left == [*range(12), *range(15, 40)]
    assert [gap.ticks for gap in reader.gaps] == [3]
    assert "removed" in reader.gaps[0].reason


@pytest.mark.parametrize("line", ["zstandard.compress", "Chunk", "zlib.crc32"])
def test_a_file_in_which_something_was_raised_is_set_aside_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    drive = Drive(tmp_path / "run")
    for ticks in (2, 12):  # the first chunk, which holds the channels, and a later one
        drive.run(ticks)
        with monkeypatch.context() as raising:
            raising.setattr(f"mcap.writer.{line}", out_of_memory)
            with pytest.raises(MemoryError):
                drive.run(3)
    drive.run(20)
    reader = RunReader(drive.end().path)
    assert seqs(reader) == list(range(drive.seq))


def out_of_memory(*_: object, **__: object) -> None:
    raise MemoryError


def test_a_file_that_is_back_in_time_costs_nothing(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    (tmp_path / "run").rename(tmp_path / "unplugged")
    with pytest.raises(FileNotFoundError, match="removed"):
        drive.run(3)
    (tmp_path / "unplugged").rename(tmp_path / "run")
    drive.run(22)
    reader = RunReader(drive.end().path)
    assert seqs(reader) == list(range(40))
    assert (reader.gaps, reader.truncated) == ([], "")


def test_a_disk_that_refuses_a_new_file_makes_no_hole_in_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(9)
    with monkeypatch.context() as refusing:
        refusing.setattr("runtime.record.segments.RecordFile", refuse)
        for _ in range(3):
            with pytest.raises(OSError, match="read-only"):
                drive.run(3)
    drive.run(22)
    reader = RunReader(drive.end().path)
    assert seqs(reader) == list(range(40))
    assert (reader.gaps, reader.truncated) == ([], "")


def refuse(*_: object) -> None:
    raise OSError(30, "read-only")


def test_a_folder_taken_away_is_made_again(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    (tmp_path / "run").rename(tmp_path / "unplugged")
    with pytest.raises(FileNotFoundError, match="removed"):
        drive.run(3)
    drive.run(7)
    (tmp_path / "run").rename(tmp_path / "elsewhere")
    (tmp_path / "unplugged").rename(tmp_path / "run")  # plugged in again, with a segment that was cut off
    with pytest.raises(FileNotFoundError, match="removed"):
        drive.run(3)
    drive.run(12)
    reader = RunReader(drive.end().path)
    left = seqs(reader)
    assert left[:15] == list(range(15))
    assert left[-12:] == list(range(27, 39))
    assert sum(gap.ticks for gap in reader.gaps) >= 39 - len(left)


@pytest.mark.soak
def test_memory_is_flat_over_five_hours_of_driving(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run", segment_ns=60 * 10 * PERIOD_NS)
    records = records_of(0, drive.rng, 200)
    room = RecordSettings(budget_gb=0.02, keep_free_gb=0.0)
    resident_bytes = []
    for minute in range(300):
        for tick in range(600):
            for record in records:
                drive.segments.add(record)
            drive.now_ns += PERIOD_NS
            if tick % CHUNK_TICKS == 0:
                drive.segments.end_chunk()
                drive.segments.write()
        make_room(drive.folder, drive.segments.manifest, room, False)
        if minute >= 30:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            resident_bytes.append(pages * os.sysconf("SC_PAGE_SIZE"))
    drive.end()
    grown_mb = (max(resident_bytes[-30:]) - max(resident_bytes[:30])) / 1e6
    sys.stdout.write(f"memory grew by {grown_mb:.2f} MB from the first hour to the last\n")
    assert grown_mb < 5.0
