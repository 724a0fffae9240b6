"""infant map as a person or a script calls it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.errors import ConfigurationError, InfantError, NotAMapError, RunExistsError, UsageError
from runtime.source_tree import CONFIG
from tests.runtime.cli.test_commands import infant
from tests.support.runtime.small_maps import map_bytes


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    path = tmp_path / "hall.map"
    path.write_bytes(map_bytes())
    return path


def refused(*words: object) -> InfantError:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert isinstance(result.exception, InfantError), result.output
    assert "\n" not in str(result.exception)
    return result.exception


def test_what_a_map_holds_is_told_to_people_and_programs(hall: Path) -> None:
    told = CliRunner().invoke(app, ["map", "info", str(hall), "--json"])
    assert json.loads(told.output)["landmarks"] == 40
    assert "40" in CliRunner().invoke(app, ["map", "info", str(hall)]).output


def test_a_damaged_map_ends_with_one_sentence_and_its_code(hall: Path) -> None:
    hall.write_bytes(map_bytes()[:-7])
    done = infant("map", "check", hall)
    assert done.returncode == 6
    assert done.stdout == ""
    assert done.stderr.startswith(f"infant: {hall} is cut off")
    assert done.stderr.count("\n") == 1


def test_every_way_to_use_a_map_refuses_one_that_is_none(hall: Path, tmp_path: Path) -> None:
    none = tmp_path / "none.map"
    none.write_bytes(b"P5 1 1 255 0")
    mock = CONFIG / "mock.toml"
    for words in (
        ("map", "info", none),
        ("map", "draw", none),
        ("map", "merge", hall, none, "--out", tmp_path / "both.map"),
        ("run", "--config", mock, "--map", none, "--out", tmp_path / "run"),
    ):
        assert isinstance(refused(*words), NotAMapError), words
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hall.map", "none.map"]


def test_a_run_is_not_begun_where_its_map_does_not_suit(hall: Path, tmp_path: Path) -> None:
    mock = CONFIG / "mock.toml"
    run = ("run", "--config", mock, "--out", tmp_path / "run")
    assert isinstance(refused(*run, "--map", hall, "--start-at", "900,0,0"), UsageError)
    assert isinstance(refused(*run, "--localise-only"), UsageError)
    given = ("--set", "slam.front_end.kind=given")
    assert isinstance(refused(*run, *given, "--map", hall, "--start-at", "0,0,0"), ConfigurationError)
    assert isinstance(refused("map", "merge", hall, hall, "--out", hall), RunExistsError)
    assert not (tmp_path / "run").exists()


def test_a_check_of_a_configuration_reads_the_map_that_it_names(hall: Path) -> None:
    mock, named = CONFIG / "mock.toml", f"map.file={hall}"
    assert CliRunner().invoke(app, ["check", "--config", str(mock), "--set", named]).exit_code == 0
    hall.write_bytes(map_bytes()[:100])
    assert "is cut off" in str(refused("check", "--config", mock, "--set", named))


def test_a_saved_map_has_no_scans_to_draw_a_grid_of(hall: Path) -> None:
    assert "no scans" in str(refused("map", "draw", hall, "--grid"))
    done = CliRunner().invoke(app, ["map", "draw", str(hall), "--json"])
    assert json.loads(done.output)["landmarks"] == 40
    assert (hall.parent / "hall_drawn" / "landmarks.csv").is_file()
