"""The recorder writes all that it is given, loses little when it is killed, and never troubles the loop."""

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from drivers.measurements import Event, WheelCounts
from runtime.errors import RunExistsError, StorageError
from runtime.messages.tick import LaserBytes, Record, decode, decode_laser_bytes
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.record.reader import RunReader
from runtime.record.writing.intake import QUEUE_ITEMS
from runtime.record.writing.recorder import Recorder, RecordObserver
from runtime.tick import CompletedTick, Tick
from slam.pose import Pose2
from tests.support.runtime.inverses import decode_can_frame
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing, same_bits

CONFIGURATION = 'rover = "infant"\nseed = 1\n'
VERSIONS = {"infant": "0.1.0", "numpy": "2.0"}


def wait_until(condition: Callable[[], bool], within_s: float = 600.0) -> None:
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen in time"
        time.sleep(0.005)


class Observer:
    """Keeps what it is shown."""

    def __init__(self) -> None:
        self.records: list[Record] = []
        self.closed: list[int] = []

    def feed(self, record: Record) -> None:
        self.records.append(record)

    def segment_closed(self, number: int, stamp_ns: int) -> None:
        self.closed.append(number)


def start(folder: Path, *observers: RecordObserver) -> Recorder:
    header = RunHeader.of_live_run(CONFIGURATION, VERSIONS)
    return Recorder(RunFolder.create(folder, folder), header, observers=observers)


def put(recorder: Recorder, seqs: range) -> list[Tick]:
    rng = np.random.default_rng(1)
    ticks = [make_tick(seq, rng, "scan" if seq % 3 else "nothing") for seq in seqs]
    for tick in ticks:
        recorder.put(
            CompletedTick(
                tick, make_estimate(tick.stamp_ns, rng), make_timing(tick.seq), bytes(16), Pose2(1.0, 2.0, 0.1)
            )
        )
    return ticks


def test_what_was_put_is_read_back(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    ticks = put(recorder, range(40))
    recorder.close()
    reader = RunReader(tmp_path / "run")
    recorded = list(reader.ticks())
    assert len(recorded) == 40
    assert all(same_bits(tick, again.tick) for tick, again in zip(ticks, recorded, strict=True))
    assert recorded[3].timing == make_timing(3)
    assert recorded[3].truth == Pose2(1.0, 2.0, 0.1)
    assert recorded[3].state_hash == bytes(16)
    assert recorded[3].estimate is not None
    assert reader.truncated == ""
    assert reader.header.configuration_text == CONFIGURATION
    assert reader.header.versions == VERSIONS
    assert reader.header.boot_id
    assert reader.header.wall_minus_monotonic_ns
    assert recorder.health().dropped == 0


def test_raw_bytes_are_kept(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    recorder.laser_bytes(5, True, b"BM\n")
    recorder.can_frame(6, 0x181, 0, b"\1\2")
    recorder.close()
    records = list(RunReader(tmp_path / "run").records())
    assert decode_laser_bytes(records[0].data) == LaserBytes(5, True, b"BM\n")
    assert decode_can_frame(records[1].topic, records[1].data) == (6, 0x181, 0, b"\1\2")


def test_another_reader_opens_a_finished_run_by_its_index(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    put(recorder, range(20))
    recorder.close()
    with (tmp_path / "run" / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
        topics = {channel.topic for channel in summary.channels.values()}
    assert {"/scan", "/tick", "/pose", "/odom", "/estimate", "/diagnostics"} <= topics


def test_an_observer_sees_what_the_file_holds(tmp_path: Path) -> None:
    observer = Observer()
    recorder = start(tmp_path / "run", observer)
    put(recorder, range(5))
    recorder.close()
    assert observer.records == list(RunReader(tmp_path / "run").records())
    assert observer.closed == []


def test_events_after_the_last_tick_are_in_the_record(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    put(recorder, range(3))
    recorder.put_events(7, (Event(7, "health", "stopping", "stopping"),))
    recorder.put_events(8, ())
    recorder.close()
    last = list(RunReader(tmp_path / "run").records())[-1]
    assert (last.topic, last.stamp_ns) == ("/diagnostics", 7)
    assert decode(last.topic, last.data).status[0].hardware_id == "stopping"
    assert len(list(RunReader(tmp_path / "run").ticks())) == 3


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    start(tmp_path / "run").close()
    before = (tmp_path / "run" / "run.mcap").read_bytes()
    with pytest.raises(RunExistsError, match="never overwritten"):
        start(tmp_path / "run")
    assert (tmp_path / "run" / "run.mcap").read_bytes() == before


def test_a_record_is_never_written_over_another(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_text("last week's")
    with pytest.raises(StorageError, match="File exists"):
        RecordFile(tmp_path / "run.mcap", {})
    assert (tmp_path / "run.mcap").read_text() == "last week's"


def test_runs_without_a_name_get_one_that_sorts_by_time(tmp_path: Path) -> None:
    folders = [RunFolder.create(None, tmp_path) for _ in range(3)]
    assert len({folder.path for folder in folders}) == 3
    assert all(folder.path.parent == tmp_path for folder in folders)


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A disk that is full at this size, by the kernel's own limit."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_a_state_and_recording_resumes_without_loss(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    with largest_file(3000):
        ticks = put(recorder, range(20))
        wait_until(lambda: recorder.health().trouble != "")
        assert "File too large" in recorder.health().trouble
    ticks += put(recorder, range(20, 30))
    wait_until(lambda: recorder.health().trouble == "")
    recorder.close()
    reader = RunReader(tmp_path / "run")
    assert [again.tick.seq for again in reader.ticks()] == [tick.seq for tick in ticks]
    assert reader.truncated == ""


def test_what_does_not_fit_is_dropped_counted_and_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.record.writing.storage.PENDING_BYTES", 20_000)
    recorder = start(tmp_path / "run")
    with largest_file(3000):
        put(recorder, range(40))
        wait_until(lambda: recorder.health().trouble != "")
        put(recorder, range(40, 80))
        wait_until(lambda: recorder.health().dropped > 0)
    wait_until(lambda: recorder.health().trouble == "")
    put(recorder, range(80, 83))
    recorder.close()
    recorded = list(RunReader(tmp_path / "run").ticks())
    told = sum(gap.ticks for tick in recorded for gap in tick.gaps)
    assert told == recorder.health().dropped == 83 - len(recorded)
    assert recorded[-1].tick.seq == 82


def test_a_removed_file_is_a_state(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    (tmp_path / "run" / "run.mcap").unlink()
    wait_until(lambda: "removed" in recorder.health().trouble)
    recorder.close()


def test_a_value_that_cannot_be_encoded_does_not_end_the_recording(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    wrong = Tick(0, 0, None, (WheelCounts("soon", 0.0, 0.0),))  # type: ignore[arg-type]
    rng = np.random.default_rng(1)
    recorder.put(CompletedTick(wrong, make_estimate(0, rng), make_timing(0), bytes(16), None))
    put(recorder, range(1, 4))
    recorder.close()
    assert "could not be encoded" in recorder.health().trouble
    recorded = list(RunReader(tmp_path / "run").ticks())
    assert [again.tick.seq for again in recorded] == [1, 2, 3]


def test_a_full_queue_drops_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.record.writing.recorder.WAKE_S", 60.0)  # the writer sleeps until it is closed
    recorder = start(tmp_path / "run")
    for stamp_ns in range(QUEUE_ITEMS + 10):
        recorder.can_frame(stamp_ns, 1, 0, b"")
    assert recorder.health().depth == QUEUE_ITEMS
    assert recorder.health().dropped == 10
    recorder.close()


def test_a_folder_that_cannot_be_written_is_said_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="--out"):
        RunFolder.create(tmp_path / "file" / "run", tmp_path)


KILLED = """
import sys, time
from pathlib import Path
from tests.runtime.record.writing.test_recorder import put, start
recorder = start(Path(sys.argv[1]))
for seq in range(100_000):
    put(recorder, range(seq, seq + 1))
    print(seq, flush=True)
    time.sleep(0.002)
"""


@pytest.mark.parametrize("after", [1, 150, 333])
def test_a_killed_recording_replays_to_its_last_whole_chunk(tmp_path: Path, after: int) -> None:
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    for line in child.stdout:
        if int(line) >= after:
            break
    child.send_signal(signal.SIGKILL)
    child.wait()
    put_last = max(after, *(int(line) for line in child.stdout if line.endswith("\n")), 0)
    child.stdout.close()
    reader = RunReader(tmp_path / "run")
    recorded = [again.tick for again in reader.ticks()]
    assert [tick.seq for tick in recorded] == list(range(len(recorded)))
    assert len(recorded) <= put_last + 2
    assert f"{len(recorded)} complete ticks" in reader.truncated


@pytest.mark.bench
def test_putting_takes_less_than_fifty_microseconds(tmp_path: Path) -> None:
    recorder = start(tmp_path / "run")
    rng = np.random.default_rng(1)
    tick, estimate = make_tick(1, rng), make_estimate(1, rng)
    costs_s = []
    for _ in range(2000):
        began_s = time.perf_counter()
        recorder.put(CompletedTick(tick, estimate, make_timing(1), bytes(16), None))
        costs_s.append(time.perf_counter() - began_s)
    recorder.close()
    assert np.percentile(costs_s, 99) < 50e-6
