"""Trouble of the recorder's surroundings is a state with its cause, and an event where something was removed."""

import os
from pathlib import Path

import numpy as np
import pytest

from runtime.messages.tick import decode
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.reader import RunReader
from runtime.record.writing import storage
from runtime.record.writing.storage import CHUNK_BYTES, MOVED, Storage
from runtime.settings.record import RecordSettings
from tests.runtime.record.test_segments import records_of
from tests.runtime.record.writing.test_recorder import put, start, wait_until

HEADER = RunHeader("seed = 1\n", "live", boot_id="b", created_utc="u")


class Clocked:
    """Storage on a clock that is moved by hand."""

    def __init__(self, path: Path, settings: RecordSettings) -> None:
        self.now_ns = 0
        self.folder = RunFolder.create(path, path)
        self.storage = Storage(self.folder, HEADER, settings, lambda: self.now_ns, lambda number, stamp_ns: None)

    def visit(self, seconds: float = 1.0) -> None:
        self.now_ns += round(seconds * 1e9)
        self.storage.visit_disk(self.now_ns)


def reasons(run: Path, kind: str) -> list[str]:
    records = [record for record in RunReader(run).records() if record.topic == "/diagnostics"]
    events = [each for record in records for each in decode(record.topic, record.data).status]
    return [each.message for each in events if each.hardware_id == kind]


def test_a_run_that_lies_on_another_disk_than_at_its_start_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clocked = Clocked(tmp_path / "run", RecordSettings(keep_free_gb=0.0))
    clocked.visit()
    assert not clocked.storage.troubles
    real, moved = os.stat, clocked.folder.path

    def elsewhere(path: object, **given: object) -> os.stat_result:
        status = real(path, **given)  # type: ignore[arg-type]
        return os.stat_result((*status[:2], status.st_dev + 1, *status[3:])) if path == moved else status

    with monkeypatch.context() as patched:
        patched.setattr("runtime.record.writing.storage.os.stat", elsewhere)
        clocked.visit()
        said = clocked.storage.troubles
    clocked.visit()
    assert said == (MOVED,)
    assert not clocked.storage.troubles  # it was plugged in again
    clocked.storage.close()


def test_each_removal_is_an_event_of_the_record(tmp_path: Path) -> None:
    clocked = Clocked(tmp_path / "run", RecordSettings(segment_s=0.5, budget_gb=1e-9, keep_free_gb=0.0))
    rng = np.random.default_rng(3)
    for seq in range(4):
        clocked.storage.add(records_of(seq, rng))
        clocked.visit(6.0)
    clocked.storage.close()
    removed = Manifest.load(clocked.folder.manifest_path).removed
    said = reasons(clocked.folder.path, "removed")
    assert len(removed) >= 2
    assert said  # those that are left: they stand in segments themselves
    assert all(any(f"run/{name} removed for room" in each for name in removed) for each in said)


def test_a_mark_that_cannot_be_taken_away_is_taken_once(tmp_path: Path) -> None:
    clocked = Clocked(tmp_path / "run", RecordSettings(keep_free_gb=0.0))
    (clocked.folder.marks_path / "stuck.txt").mkdir(parents=True)
    for _ in range(5):
        clocked.visit()
    (trouble,) = clocked.storage.troubles
    assert "stuck.txt: a mark was kept and its file cannot be removed" in trouble
    (clocked.folder.marks_path / "stuck.txt").rmdir()
    clocked.visit()
    assert clocked.storage.troubles == ()
    clocked.storage.close()
    assert len(Manifest.load(clocked.folder.manifest_path).marks) == 1


def test_what_waited_behind_a_disk_becomes_chunks_that_any_reader_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage, "CHUNK_BYTES", 50_000)
    clocked = Clocked(tmp_path / "run", RecordSettings(keep_free_gb=0.0))
    rng = np.random.default_rng(3)
    for seq in range(40):
        clocked.storage.add(records_of(seq, rng))
    clocked.storage.close()
    content = clocked.folder.mcap_path.read_bytes()
    assert content.count(b"checkpoint") > 3
    assert CHUNK_BYTES < 32 << 20


def test_less_than_half_a_second_is_in_memory(tmp_path: Path) -> None:
    clocked = Clocked(tmp_path / "run", RecordSettings(keep_free_gb=0.0))
    rng, written = np.random.default_rng(3), [0]
    for seq in range(60):
        clocked.storage.add(records_of(seq, rng))
        clocked.visit(storage.WAKE_S)
        written.append(clocked.folder.mcap_path.stat().st_size)
    grown_at = [beat for beat in range(1, 61) if written[beat] > written[beat - 1]]
    waited_s = storage.WAKE_S * (np.diff([0, *grown_at, 60]).max() + 1)  # it may have come just after the last visit
    assert waited_s < 0.5
    clocked.storage.close()


def test_an_error_in_the_recorders_thread_costs_a_round_and_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = start(tmp_path / "run")
    with monkeypatch.context() as patched:

        def broken(self: Storage, now_ns: int) -> None:
            raise ZeroDivisionError("a defect")

        patched.setattr(Storage, "visit_disk", broken)
        wait_until(lambda: "ZeroDivisionError" in recorder.health().trouble)
    wait_until(lambda: recorder.health().trouble == "")
    put(recorder, range(3))
    recorder.close()
    assert len(list(RunReader(tmp_path / "run").ticks())) == 3
