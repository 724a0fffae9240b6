"""A damaged run gives its exact prefix and says where it ends; nothing that was altered is returned."""

from pathlib import Path

import numpy as np
import pytest

from runtime.errors import NotARunError
from runtime.messages.recorded_tick import RecordedTick
from runtime.messages.records import tick_records
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.record.mcap_prefix import McapPrefix
from runtime.record.reader import RunReader
from runtime.tick import CompletedTick
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing, same_bits

TICKS_A_CHUNK = 3


def write_run(folder: Path, ticks: int = 12) -> list[int]:
    """A run of chunks of three ticks; returns the file's size after each chunk."""
    folder.mkdir()
    rng = np.random.default_rng(3)
    file = RecordFile(folder / "run.mcap", RunHeader("seed = 1\n", "live").metadata, {"truth.npz": b"12345"})
    ends = []
    for seq in range(ticks):
        tick = make_tick(seq, rng, ("scan", "sightings", "nothing")[seq % 3], 40)
        estimate = make_estimate(tick.stamp_ns, rng, 40)
        for record in tick_records(CompletedTick(tick, estimate, make_timing(seq), bytes([seq] * 16), None)):
            file.add(record)
        if seq % TICKS_A_CHUNK == TICKS_A_CHUNK - 1:
            file.end_chunk()
            file.write()
            ends.append((folder / "run.mcap").stat().st_size)
    file.finish()
    file.write()
    file.sync()
    file.close()
    return ends


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int], list[RecordedTick]]:
    folder = tmp_path_factory.mktemp("whole") / "run"
    ends = write_run(folder)
    return (folder / "run.mcap").read_bytes(), ends, list(RunReader(folder).ticks())


def is_prefix(recorded: list[RecordedTick], of: list[RecordedTick]) -> bool:
    return all(
        same_bits(first.tick, second.tick) and first.state_hash == second.state_hash
        for first, second in zip(recorded, of[: len(recorded)], strict=True)
    )


def test_a_whole_run_is_read_whole(whole: tuple[bytes, list[int], list[RecordedTick]]) -> None:
    assert [again.tick.seq for again in whole[2]] == list(range(12))


def test_attachments_and_header_are_known_before_the_ticks(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    reader = RunReader(tmp_path / "run")
    assert reader.attachments["truth.npz"] == b"12345"
    assert reader.header.source == "live"


def test_a_cut_at_any_byte_of_the_last_two_chunks_gives_the_exact_prefix(
    tmp_path: Path, whole: tuple[bytes, list[int], list[RecordedTick]]
) -> None:
    content, ends, ticks = whole
    folder = tmp_path / "run"
    folder.mkdir()
    path = folder / "run.mcap"
    path.write_bytes(content)
    seqs = [again.tick.seq for again in ticks]
    with path.open("r+b") as stream:
        for size in range(len(content) - 1, ends[-3], -1):
            stream.truncate(size)
            file = McapPrefix(path)
            topics = [topic for topic, _, _ in file.messages()]
            chunks = sum(size >= end_of_chunk(content, end) for end in ends)
            assert topics.count("/tick") == chunks * TICKS_A_CHUNK, size
            assert file.damage, size
    reader = RunReader(folder)
    recorded = list(reader.ticks())
    assert [again.tick.seq for again in recorded] == seqs[: 2 * TICKS_A_CHUNK]
    assert is_prefix(recorded, ticks)
    assert "6 complete ticks can be read, the last one 0.5 s after the first" in reader.truncated
    by_topic = RunReader(folder)
    assert sum(record.topic == "/tick" for record in by_topic.records(("/tick", "/estimate"))) == 2 * TICKS_A_CHUNK
    assert by_topic.truncated == reader.truncated, "whoever reads them"


def end_of_chunk(content: bytes, end: int) -> int:
    """Where the chunk record itself ends that is followed, up to `end`, by its message indexes."""
    file_end, position = end, 8
    last = position
    while position < file_end:
        opcode, length = content[position], int.from_bytes(content[position + 1 : position + 9], "little")
        position += 9 + length
        if opcode == 6:
            last = position
    return last


@pytest.mark.parametrize("damage", ["flip", "zero", "noise"])
def test_damage_anywhere_is_reported_and_never_returned(
    tmp_path: Path, whole: tuple[bytes, list[int], list[RecordedTick]], damage: str
) -> None:
    content, _, ticks = whole
    folder = tmp_path / "run"
    folder.mkdir()
    rng = np.random.default_rng({"flip": 1, "zero": 2, "noise": 3}[damage])
    for _ in range(60):
        spoilt = bytearray(content)
        at = int(rng.integers(8, len(content)))
        match damage:
            case "flip":
                spoilt[at] ^= 1 << int(rng.integers(8))
            case "zero":
                spoilt[at : at + 512] = bytes(len(spoilt[at : at + 512]))
            case "noise":
                spoilt[at : at + 512] = rng.bytes(len(spoilt[at : at + 512]))
        if spoilt == content:
            continue
        (folder / "run.mcap").write_bytes(spoilt)
        try:
            reader = RunReader(folder)
            recorded = list(reader.ticks())
        except NotARunError:
            continue
        assert is_prefix(recorded, ticks)
        assert reader.truncated, at


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"not a record at all", bytes(4096)])
def test_a_file_without_a_head_is_no_run(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "run.mcap").write_bytes(content)
    with pytest.raises(NotARunError, match="cannot be read as a run") as caught:
        RunReader(tmp_path)
    assert caught.value.exit_code == 6


def test_a_folder_without_a_record_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(NotARunError, match=r"it has no run\.mcap"):
        RunReader(tmp_path)
    with pytest.raises(NotARunError, match="does not exist"):
        RunReader(tmp_path / "nowhere")


def test_the_run_can_be_named_by_its_file(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    assert sum(1 for _ in RunReader(tmp_path / "run" / "run.mcap").ticks()) == 12


def test_a_changed_configuration_is_not_believed(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    path = tmp_path / "run" / "run.mcap"
    path.write_bytes(path.read_bytes().replace(b"seed = 1", b"seed = 7", 1))
    with pytest.raises(NotARunError, match="differs from what was written"):
        RunReader(path)


def test_a_run_of_another_format_is_refused_by_name(tmp_path: Path) -> None:
    metadata = RunHeader("", "live").metadata
    metadata["infant"]["format"] = "99"
    file = RecordFile(tmp_path / "run.mcap", metadata)
    file.finish()
    file.write()
    file.close()
    with pytest.raises(NotARunError, match="its format is 99"):
        RunReader(tmp_path)
