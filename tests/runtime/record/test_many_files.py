"""A folder with thousands of files that no recorder left is read in a bounded time, and told about in a few words."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.page.run_list import MOST_FILES, MOST_RUNS, RunList, recorded_runs
from runtime.record.check import recover_run, run_info, verify_run
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.record.marks import MOST_MARKS, take_marks
from runtime.record.reader import RunReader
from tests.support.runtime.hostile_runs import run_with

MANY = 3000
TIMES, MOST = 4, 9.0  # so many times the lines cost so many times as much at most: 16 where it grows with the square


def fill(folder: Path, pattern: str, content: bytes = b"") -> None:
    for number in range(1, MANY + 1):
        (folder / pattern.format(number)).write_bytes(content)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"junk" * 16])
def test_segments_that_hold_nothing_are_one_sentence(tmp_path: Path, content: bytes) -> None:
    run = run_with(tmp_path / "run", b"")
    fill(run, "run-{:04d}.mcap", content)
    damages = [each for each in verify_run(run).damages if "run-0001.mcap" in each]
    assert len(damages) == 1
    assert damages[0].startswith(f"run-0001.mcap to run-{MANY}.mcap: ")
    assert len(run_info(run)["segments"]) == MANY + 1
    reader = RunReader(run, tolerant=True)
    assert list(reader.records()) == []
    assert len(reader.truncated) < 1000
    losses = recover_run(run, RunFolder.create(tmp_path / "out", tmp_path))["losses"]
    assert len(losses) < 5


def test_two_kinds_of_damage_are_two_sentences_and_the_sound_segment_between_is_none(tmp_path: Path) -> None:
    run = run_with(tmp_path / "run", b"")
    sound = (run / "run.mcap").read_bytes()
    for number, content in enumerate((b"", b"", sound, b"", b"junk" * 9, b"junk" * 8), 1):
        (run / f"run-{number:04d}.mcap").write_bytes(content)
    reader = RunReader(run, tolerant=True)
    list(reader.records())
    starts = [damage.partition(":")[0] for damage in reader.damages]
    assert starts[0] == "run-0001.mcap to run-0002.mcap"
    assert "run-0004.mcap to run-0006.mcap" in starts


def test_names_that_no_run_reaches_are_one_sentence(tmp_path: Path) -> None:
    run = run_with(tmp_path / "run", b"")
    fill(run, "run-9{:09d}.mcap")
    (damage,) = (each for each in verify_run(run).damages if "no run has so many" in each)
    assert damage.startswith(f"{MANY} segments, run-9000000001.mcap to run-9{MANY:09d}.mcap: ")


@pytest.mark.parametrize("made", [os.mkfifo, Path.mkdir, lambda path: path.symlink_to("nowhere")])
def test_what_is_no_file_is_no_segment(tmp_path: Path, made: Callable[[Path], None]) -> None:
    run = run_with(tmp_path / "run", b"")
    made(run / "run-0001.mcap")
    assert RunFolder(run).closed_segments() == {}
    assert RunFolder(run).foreign_segments() == ["run-0001.mcap"]


def test_a_manifest_of_thousands_of_lines_does_not_cost_their_square(tmp_path: Path) -> None:
    few, many = (manifest_of(tmp_path / f"run-of-{lines}", lines) for lines in (2 * MANY // TIMES, 2 * MANY))
    cost_of_looking_s(few)  # whatever is made once
    assert cost_of_looking_s(many) < MOST * min(cost_of_looking_s(few) for _ in range(3))


def manifest_of(folder: Path, lines: int) -> Path:
    run = run_with(folder, b"")
    manifest = Manifest(run / "manifest.jsonl")
    for number in range(1, lines + 1):
        name, other = f"run-{2 * number:04d}.mcap", f"run-{2 * number + 1:04d}.mcap"
        (run / name).touch()
        facts = {"bytes": 0, "sha256": "", "first_ns": number, "last_ns": number, "ticks": 1}
        manifest.add("segment", name=name, number=2 * number, **facts)
        manifest.add("removed", name=other, reason=f"removed for room {number}")
        manifest.add("mark", from_ns=10**9 + 3 * number, to_ns=10**9 + 3 * number, reason="x")
    manifest.save()
    return run


def cost_of_looking_s(run: Path) -> float:
    began_s = time.process_time()
    verify_run(run)
    run_info(run)
    return time.process_time() - began_s


def test_a_segment_is_marked_where_any_mark_touches_it() -> None:
    spans = [(0, 5), (6, 9), (10, 10), (11, 30), (31, 40)]
    marks = [(12, 13), (25, 26), (7, 7), (40, 60), (10, 10)]
    manifest = Manifest(Path("manifest.jsonl"))
    for number, (first, last) in enumerate(spans, 1):
        manifest.add("segment", name=f"{number}", number=number, first_ns=first, last_ns=last)
    assert manifest.marked(map(str, range(1, 7))) == set()
    for begin, end in marks:
        manifest.add("mark", from_ns=begin, to_ns=end, reason="x")
    touched = {
        f"{number}"
        for number, (first, last) in enumerate(spans, 1)
        if any(begin <= last and first <= end for begin, end in marks)
    }
    assert touched == {"2", "3", "4", "5"}
    assert manifest.marked(map(str, range(1, 7))) == touched | {"6"}, "what is not closed may lie in any"


def test_marks_are_taken_some_at_a_time_out_of_any_number(tmp_path: Path) -> None:
    run = run_with(tmp_path / "run", b"")
    (run / "marks").mkdir()
    fill(run / "marks", "{:04d}.txt", b"why")
    taken = take_marks(RunFolder(run))
    assert len(taken) == MOST_MARKS
    assert set(taken.values()) == {"why"}


def test_the_list_of_runs_looks_at_a_part_of_what_is_too_much(tmp_path: Path) -> None:
    for number in range(MOST_RUNS + 5):
        run_with(tmp_path / f"run-{number:03d}", b"")
    newest = tmp_path / f"run-{MOST_RUNS + 4:03d}"
    fill(newest, "run-{:04d}.mcap", b"x" * 1000)
    (tmp_path / "zz_nothing").mkdir()
    fill(tmp_path / "zz_nothing", "film-{:04d}.mkv")
    runs = recorded_runs(tmp_path)
    assert [run["name"] for run in runs[:2]] == [newest.name, f"run-{MOST_RUNS + 3:03d}"]
    assert len(runs) == MOST_RUNS
    assert [run["is_all"] for run in runs[:2]] == [False, True]
    assert 0.0 < runs[0]["mb"] <= MOST_FILES / 1000


def test_the_list_of_runs_is_looked_up_once_for_all_who_ask_at_once(tmp_path: Path) -> None:
    runs = RunList(tmp_path)
    first = runs.told()
    run_with(tmp_path / "run", b"")
    assert runs.told() is first
    assert len(RunList(tmp_path).told()["runs"]) == 1
