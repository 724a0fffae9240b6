"""infant log and infant mark as a person uses them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from runtime.cli.__main__ import app
from runtime.errors import NotARunError, RunExistsError, StorageError
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from tests.runtime.record.test_segments import Drive, driven
from tests.support.runtime.hostile_runs import write_manifest


def infant(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    return driven(tmp_path / "runs" / "run")


def spoil(path: Path) -> None:
    path.chmod(0o644)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_info_lists_every_segment(run: RunFolder) -> None:
    said = infant("log", "info", run.path).stdout
    assert said.count("segment ") == 4
    assert "manifest  whole" in said
    assert "version   infant" in said
    facts = json.loads(infant("log", "info", run.path, "--json").stdout)
    assert [segment["name"] for segment in facts["segments"]] == [path.name for path in run.segment_paths()]
    first, last = facts["segments"][0], facts["segments"][-1]
    assert first["from_s"] != 0.0
    assert said.splitlines()[3].endswith(f"  0.0 to {first['to_s'] - first['from_s']:.1f} s"), "since the run began"
    assert said.splitlines()[6].endswith(f" to {last['to_s'] - first['from_s']:.1f} s")


def test_a_whole_run_verifies_with_exit_code_zero(run: RunFolder) -> None:
    result = infant("log", "verify", run.path)
    assert result.exit_code == 0
    assert "40 ticks in 4 segment(s), 0 gap(s)" in result.stdout
    assert result.stdout.endswith("intact    every byte is as it was written\n")


def test_damage_is_an_error_of_storage_that_names_the_segment(run: RunFolder) -> None:
    spoil(run.closed_path(2))
    result = infant("log", "verify", run.path, "--json")
    found = json.loads(result.stdout)
    assert found["whole"] is False
    assert all("run-0002.mcap" in sentence for sentence in found["damages"])
    assert isinstance(result.exception, StorageError)
    assert result.exception.exit_code == 6
    assert "infant log recover" in str(result.exception)


def test_a_run_being_recorded_is_not_called_damaged(tmp_path: Path) -> None:
    drive = Drive(tmp_path / "run")
    drive.run(15)
    result = infant("log", "verify", tmp_path / "run")
    assert result.exit_code == 0
    assert "still being recorded" in result.stdout
    assert "intact" not in result.stdout
    assert "open" in infant("log", "info", tmp_path / "run").stdout


def test_what_is_recovered_verifies_and_overwrites_nothing(run: RunFolder, tmp_path: Path) -> None:
    spoil(run.closed_path(2))
    before = {path.name: path.read_bytes() for path in run.segment_paths()}
    result = infant("log", "recover", run.path, "--out", tmp_path / "saved")
    assert result.exit_code == 0
    assert "lost      run-0002.mcap" in result.stdout
    assert infant("log", "verify", tmp_path / "saved").exit_code == 0
    assert {path.name: path.read_bytes() for path in run.segment_paths()} == before
    again = infant("log", "recover", run.path, "--out", tmp_path / "saved")
    assert isinstance(again.exception, RunExistsError)


def test_a_mark_is_shown_by_info(run: RunFolder) -> None:
    assert infant("mark", "a branch on the laser", "--run", run.path).exit_code == 0
    said = infant("log", "info", run.path).stdout
    assert "mark      a branch on the laser" in said
    assert said.count("  marked") == 4


def test_fifty_thousand_marks_do_not_fill_the_terminal(run: RunFolder) -> None:
    marks = [{"kind": "mark", "from_ns": 0, "to_ns": 1, "reason": f"mark {number}"} for number in range(50_000)]
    manifest = Manifest.load(run.manifest_path)
    lines = [{k: v for k, v in line.items() if k != "chain"} for line in manifest.lines]
    write_manifest(run.path, *lines, *marks)
    said = infant("log", "info", run.path).stdout
    assert len(said.splitlines()) < 100
    assert "mark      ... and 49960 more; --json shows all" in said
    assert len(json.loads(infant("log", "info", run.path, "--json").stdout)["marks"]) == 50_000


def test_what_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    for words in (("info",), ("verify",), ("recover", "--out", str(tmp_path / "out"))):
        result = infant("log", words[0], tmp_path / "nothing", *words[1:])
        assert isinstance(result.exception, NotARunError)
        assert "does not exist" in str(result.exception)
    assert not (tmp_path / "out").exists()
