"""Room is made by the oldest segments that nobody marked; imports, marked ones and what is written stay."""

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from runtime.errors import NotARunError, UsageError
from runtime.record.check import verify_run
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.marks import leave_mark, running_run
from runtime.record.reader import RunReader
from runtime.record.room import is_being_written, make_room
from runtime.settings.record import RecordSettings
from tests.runtime.record.test_segments import Drive, driven, seqs
from tests.runtime.record.writing.test_recorder import put, wait_until

NO_RESERVE = {"keep_free_gb": 0.0}


def budget_of(*paths: Path, spare: int = 0) -> RecordSettings:
    """A budget that these files just fit into."""
    return RecordSettings(budget_gb=(sum(path.stat().st_size for path in paths) + spare) / 1e9, **NO_RESERVE)


def test_the_oldest_segments_go_first_and_the_record_says_so(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    manifest = Manifest.load(folder.manifest_path)
    settings = budget_of(*folder.segment_paths()[2:])
    assert make_room(folder, manifest, settings, False).trouble == ""
    assert [path.name for path in folder.segment_paths()] == ["run-0003.mcap", "run.mcap"]
    reader = RunReader(folder.path)
    assert seqs(reader) == list(range(24, 40))
    assert [gap.ticks for gap in reader.gaps] == [24]
    assert "removed for room: runs take" in reader.truncated
    found = verify_run(folder.path)
    assert found.damages == []  # the record says itself what it lacks
    assert len(found.gaps) == 2  # both segments in one sentence, and their ticks


def test_a_marked_segment_and_its_neighbours_stay(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(30)  # in the third segment
    drive.segments.mark("a branch on the laser")
    drive.run(42)
    folder = drive.end()
    manifest = Manifest.load(folder.manifest_path)
    said = make_room(folder, manifest, RecordSettings(budget_gb=1e-9, **NO_RESERVE), False).trouble
    assert "no unmarked segment to remove" in said
    left = [path.name for path in folder.segment_paths()]
    assert left == ["run-0002.mcap", "run-0003.mcap", "run-0004.mcap"]


def test_older_runs_go_before_this_one_but_an_import_never_goes(tmp_path: Path) -> None:
    older = driven(tmp_path / "b-older")
    newer = driven(tmp_path / "a-newer")
    (tmp_path / "import").mkdir()
    (tmp_path / "import" / "run.mcap").write_bytes(bytes(100_000))
    manifest = Manifest.load(newer.manifest_path)
    assert make_room(newer, manifest, budget_of(*newer.segment_paths()), False).trouble == ""
    assert older.segment_paths() == []
    assert len(newer.segment_paths()) == 4
    assert len(Manifest.load(older.manifest_path).removed) == 4
    assert (tmp_path / "import" / "run.mcap").stat().st_size == 100_000


def test_without_a_budget_other_runs_are_not_touched_even_on_a_full_disk(tmp_path: Path) -> None:
    older = driven(tmp_path / "older")
    newer = driven(tmp_path / "newer")
    manifest = Manifest.load(newer.manifest_path)
    made = make_room(newer, manifest, RecordSettings(keep_free_gb=100_000.0), True)
    assert "would not reach" in made.trouble
    assert len(made.removed) == 1  # so that the record goes on; more of them would help nobody
    assert len(newer.segment_paths()) == 3
    assert len(older.segment_paths()) == 4


@pytest.mark.parametrize("allowed", [True, False])
def test_where_allowed_older_runs_go_for_free_space_before_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, allowed: bool
) -> None:
    older, newer = driven(tmp_path / "older"), driven(tmp_path / "newer")
    of_old = sum(path.stat().st_size for path in older.segment_paths())

    def disk(path: Path) -> SimpleNamespace:
        left = sum(each.stat().st_size for run in (older, newer) for each in run.segment_paths())
        return SimpleNamespace(f_bavail=2 * of_old + 1_000_000 - left, f_frsize=1)

    monkeypatch.setattr("runtime.record.room.os.statvfs", disk)
    settings = RecordSettings(keep_free_gb=(1_000_000 + of_old / 2) / 1e9, remove_older_runs=allowed)
    made = make_room(newer, Manifest.load(newer.manifest_path), settings, False)
    assert made.trouble == ""
    assert {name.split("/")[0] for name in made.removed} == {"older" if allowed else "newer"}
    assert len(newer.segment_paths() if allowed else older.segment_paths()) == 4


def test_nothing_goes_where_it_would_not_help(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    made = make_room(folder, Manifest.load(folder.manifest_path), RecordSettings(keep_free_gb=100_000.0), False)
    assert made.removed == []
    assert "would not reach" in made.trouble
    assert len(folder.segment_paths()) == 4


def test_a_segment_that_cannot_be_removed_hides_none_that_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = driven(tmp_path / "run")
    unlink = Path.unlink

    def refusing(path: Path, missing_ok: bool = False) -> None:
        if path.name == "run-0002.mcap":
            raise PermissionError(13, "Permission denied", str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", refusing)
    made = make_room(folder, Manifest.load(folder.manifest_path), budget_of(folder.mcap_path), False)
    assert [sentence.split()[0] for sentence in made.removed] == ["run/run-0001.mcap"]
    assert made.trouble == f"{folder.closed_path(2)} cannot be removed (Permission denied)"


def test_what_is_being_written_stays(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    assert is_being_written(drive.folder.mcap_path)
    assert not is_being_written(drive.folder.closed_path(1))
    assert not is_being_written(drive.folder.path / "run-0099.mcap"), "what is gone is written by nobody"
    make_room(drive.folder, drive.segments.manifest, RecordSettings(budget_gb=1e-9, **NO_RESERVE), False)
    assert drive.folder.segment_paths() == [drive.folder.mcap_path]


def test_a_mark_reaches_the_running_recorder_and_the_log(tmp_path: Path) -> None:
    from tests.runtime.record.writing.test_recorder import start

    recorder = start(tmp_path / "runs" / "run")
    put(recorder, range(3))
    folder = running_run(tmp_path / "runs")
    assert leave_mark(folder, "a branch on the laser", within_s=120.0)
    recorder.close()
    assert [mark["reason"] for mark in Manifest.load(folder.manifest_path).marks] == ["a branch on the laser"]
    diagnostics = [record for record in RunReader(folder.path).records() if record.topic == "/diagnostics"]
    assert any(b"a branch on the laser" in record.data for record in diagnostics)
    assert list(folder.marks_path.iterdir()) == []


def test_a_run_that_has_ended_is_marked_as_a_whole(tmp_path: Path) -> None:
    folder = driven(tmp_path / "run")
    assert leave_mark(folder, "the one with the kerb")
    manifest = Manifest.load(folder.manifest_path)
    names = {path.name for path in folder.segment_paths()}
    assert manifest.marked(names) == names
    assert verify_run(folder.path).damages == []


def test_a_mark_that_waits_keeps_the_run(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    assert not leave_mark(drive.folder, "nobody reads this yet", within_s=0.05)
    assert make_room(drive.folder, drive.segments.manifest, RecordSettings(budget_gb=1e-9, **NO_RESERVE), False).trouble
    assert len(drive.folder.segment_paths()) == 2


def test_a_mark_needs_a_reason_and_a_run(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="say what you saw"):
        leave_mark(driven(tmp_path / "run"), " ")
    with pytest.raises(NotARunError, match="no run is being recorded"):
        running_run(tmp_path)


def test_the_recorder_keeps_its_budget_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from runtime.record.folder import RunFolder
    from runtime.record.writing.recorder import Recorder

    monkeypatch.setattr("runtime.record.writing.storage.ROOM_NS", 0)
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    settings = RecordSettings(segment_s=0.5, budget_gb=1e-9, **NO_RESERVE)
    recorder = Recorder(folder, RunHeader.of_live_run("seed = 1\n", {}), settings)
    pause = threading.Event()
    for seq in range(40):
        put(recorder, range(seq, seq + 1))
        pause.wait(0.05)
    wait_until(lambda: "run-0001.mcap" in Manifest.load(folder.manifest_path).removed)
    recorder.close()
    reader = RunReader(folder.path)
    kept = seqs(reader)  # none where the last segment was closed just then
    assert kept == list(range(40 - len(kept), 40))
    assert sum(gap.ticks for gap in reader.gaps) == 40 - len(kept) > 0
