"""Bytes of others, with checksums that are right: refused with their place, in little memory and time."""

import os
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.errors import NotARunError, StorageError
from runtime.messages.records import tick_records
from runtime.messages.tick import Record
from runtime.record.check import recover_run, run_info, verify_run
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.record.marks import running_run
from runtime.record.mcap_prefix import MAGIC, METADATA, McapPrefix
from runtime.record.reader import RunReader
from runtime.tick import CompletedTick
from tests.support.runtime.hostile_runs import (
    HEADER,
    channel,
    chunk,
    message,
    record,
    run_of,
    run_with,
    text,
    with_segment,
    write_manifest,
)
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing

MB = 1 << 20


def records_of(seq: int) -> list[Record]:
    rng = np.random.default_rng(seq)
    tick = make_tick(seq, rng, "scan", 40)
    estimate = make_estimate(tick.stamp_ns, rng, 40)
    return tick_records(CompletedTick(tick, estimate, make_timing(seq), bytes(16), None))


def changed(records: list[Record], topic: str, data: Callable[[bytes], bytes]) -> list[Record]:
    return [Record(each.topic, each.stamp_ns, data(each.data)) if each.topic == topic else each for each in records]


HOSTILE: dict[str, bytes] = {
    "a chunk of 100 MB in 10 kB": chunk(bytes(100 * MB)),
    "a thousand chunks of a megabyte each": chunk(bytes(MB)) * 1000,
    "a thousand small chunks of nothing but messages": chunk(channel(1, "/x") + message(1, b"") * 2000) * 1000,
    "a record that says it is longer than its chunk": chunk(record(5, b"") + b"\x05" + b"\xff" * 8),
    "a message of a channel that is not there": chunk(message(7, b"")),
    "a message without its head": chunk(channel(1, "/tick") + record(5, b"\0")),
    "a topic of a megabyte": chunk(np.random.default_rng(1).bytes(64) + channel(1, "/" + "t" * MB)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_no_recorder_writes_is_refused_in_little_memory(tmp_path: Path, name: str) -> None:
    run = run_with(tmp_path / "run", HOSTILE[name])
    tracemalloc.start()
    try:
        damages = verify_run(run).damages
        with pytest.raises(NotARunError, match=r"run\.mcap"):
            list(RunReader(run).records())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert any("at byte" in damage for damage in damages), damages
    assert peak < 80 * MB, f"{peak / MB:.0f} MB"


def test_a_head_without_end_is_refused_in_little_memory(tmp_path: Path) -> None:
    metadata = b"".join(record(METADATA, text(f"{k}") + struct.pack("<I", 0)) for k in range(200_000))
    (tmp_path / "run.mcap").write_bytes(MAGIC + record(1, text("ros2") + text("")) + metadata)
    tracemalloc.start()
    with pytest.raises(NotARunError, match="metadata and attachments"):
        RunReader(tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 40 * MB
    tracemalloc.stop()


@pytest.mark.parametrize("number", ["1000000000000000", "-1", "", "1e3", "²", "1" * 5000])
def test_a_segment_number_that_no_run_reaches_is_refused(tmp_path: Path, number: str) -> None:
    run = run_with(tmp_path / "run", b"", with_segment(number))
    for read in (run_info, RunReader, lambda path: recover_run(path, RunFolder.create(tmp_path / "saved", tmp_path))):
        with pytest.raises(NotARunError, match="segment has the number"):
            read(run)


@pytest.mark.parametrize("name", ["run-99999999999.mcap", f"run-{10**40}.mcap", "run-0000000001.mcap"])
def test_a_file_with_the_name_of_such_a_segment_is_named(tmp_path: Path, name: str) -> None:
    run = run_of(tmp_path / "run", [records_of(1)])
    (run / name).write_bytes((run / "run.mcap").read_bytes())
    assert any(name in damage for damage in verify_run(run).damages)
    with pytest.raises(NotARunError, match=name):
        RunReader(run)


def test_a_hundred_thousand_segments_that_are_gone_are_one_sentence(tmp_path: Path) -> None:
    run = run_with(tmp_path / "run", chunk(channel(1, "/other") + message(1, b"")), with_segment("100000"))
    damages = verify_run(run).damages
    assert "run-0001.mcap to run-99999.mcap are missing: unknown reason" in damages


def test_a_pipe_with_the_name_of_a_segment_is_named_and_keeps_nobody(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", [records_of(1)])
    os.mkfifo(run / "run-0001.mcap")
    assert any("run-0001.mcap" in damage for damage in verify_run(run).damages)
    with pytest.raises(NotARunError, match=r"run-0001\.mcap"):
        run_info(run)
    (tmp_path / "runs" / "a").mkdir(parents=True)
    os.mkfifo(tmp_path / "runs" / "a" / "run.mcap")
    with pytest.raises(NotARunError, match="no run is being recorded"):
        running_run(tmp_path / "runs")


SEGMENT = {"kind": "segment", "name": "run-0001.mcap", "number": 1, "bytes": 1, "sha256": "", "ticks": 1}
SEGMENT |= {"first_ns": 0, "last_ns": 0}
WRONG_LINES: dict[str, dict[str, Any]] = {
    "a list for a name": {**SEGMENT, "name": ["a"]},
    "a number of a thousand digits": {**SEGMENT, "ticks": 10**1000},
    "a truth for a number": {**SEGMENT, "number": True},
    "a mark without a span": {"kind": "mark", "reason": "x"},
    "a kind that is a table": {"kind": {"segment": 1}},
    "a kind of its own": {"kind": "bomb"},
    "a reason of a megabyte": {"kind": "removed", "name": "run-0001.mcap", "reason": "x" * MB},
}


@pytest.mark.parametrize("name", WRONG_LINES)
def test_a_manifest_of_right_hashes_and_wrong_values_is_damage(tmp_path: Path, name: str) -> None:
    run = run_of(tmp_path / "run", [records_of(1)])
    path = write_manifest(run, {"kind": "run", "created_utc": ""}, WRONG_LINES[name])
    assert "from line 2 on" in Manifest.load(path).damage
    assert verify_run(run).damages


def test_a_manifest_of_endless_brackets_or_endless_size_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "manifest.jsonl"
    path.write_bytes(b"[" * 10_000 + b"\n")
    assert "from line 1 on" in Manifest.load(path).damage
    with path.open("wb") as stream:
        stream.truncate(1 << 40)
    assert "more than" in Manifest.load(path).damage


def test_ticks_without_meaning_are_named_by_verify_and_left_out_by_recover(tmp_path: Path) -> None:
    ticks = [records_of(seq) for seq in range(6)]
    ticks[1] = changed(ticks[1], "/tick", lambda data: b"\xff" * len(data))
    ticks[2] = changed(ticks[2], "/scan", lambda data: data[:30])
    ticks[4] = changed(ticks[4], "/estimate", lambda data: data[:200])
    run = run_of(tmp_path / "run", ticks)
    with pytest.raises(NotARunError, match=r"run\.mcap, byte \d+: an invalid record of /tick"):
        list(RunReader(run).ticks())
    found = verify_run(run)
    assert (found.ticks, len(found.damages)) == (4, 4)  # the tick of a scan that says nothing says nothing either
    result = recover_run(run, RunFolder.create(tmp_path / "saved", tmp_path))
    saved = list(RunReader(tmp_path / "saved").ticks())
    assert [each.tick.seq for each in saved] == [0, 3, 4, 5]
    assert sum(gap.ticks for each in saved for gap in each.gaps) == 2
    assert [each.estimate is None for each in saved] == [False, False, True, False]
    assert len(result["losses"]) == 4
    assert verify_run(tmp_path / "saved").damages == []


def test_topics_that_this_release_does_not_know_are_carried_over(tmp_path: Path) -> None:
    content = channel(1, "/future") + message(1, b"whatever it says") + channel(2, "/segment") + message(2, b"7")
    run = run_with(tmp_path / "run", chunk(content))
    recover_run(run, RunFolder.create(tmp_path / "saved", tmp_path))
    saved = McapPrefix(tmp_path / "saved" / "run.mcap")
    assert [(topic, data) for topic, _, data in saved.messages()] == [
        ("/future", b"whatever it says"),
        ("/segment", b"7"),
    ]


def test_a_start_map_that_is_a_link_is_left_behind_and_named(tmp_path: Path) -> None:
    run = run_with(tmp_path / "run", chunk(channel(1, "/future")))
    (run / "start.map").symlink_to("/etc/passwd")
    saved = RunFolder.create(tmp_path / "saved", tmp_path)
    assert "start.map cannot be read (Too many levels" in recover_run(run, saved)["losses"][0]
    assert not saved.start_map_path.exists()


def test_replays_behind_a_link_are_neither_written_nor_read(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    run_of(victim / "other", [records_of(1)])
    (victim / "other" / "summary.json").write_text("{}")
    folder = RunFolder(run_of(tmp_path / "run", [records_of(1)]))
    folder.replays_path.symlink_to(victim)
    for use in (folder.newest_replay, lambda: folder.new_replay(None)):
        with pytest.raises(StorageError, match=r"replays cannot be used \(it is a link"):
            use()
    folder.replays_path.unlink()
    folder.replays_path.mkdir()
    (folder.replays_path / "one").symlink_to(victim / "other")
    with pytest.raises(StorageError, match="it is a link"):
        folder.newest_replay()
    assert sorted(path.name for path in victim.iterdir()) == ["other"]


def test_the_head_of_a_run_of_others_is_printable(tmp_path: Path) -> None:
    metadata = HEADER.metadata
    metadata["infant"] |= {"source": "live\x1b[2J", "created_utc": "\r\nFAKE"}
    facts = run_info(run_with(tmp_path / "run", b"", metadata))
    assert (facts["source"], facts["created_utc"]) == ("live\\x1b[2J", "\\r\\nFAKE")
