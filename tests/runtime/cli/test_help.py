"""The help reads as a person needs it, and errors as a program does."""

import json
import shlex
import sys
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from runtime.cli import __main__ as cli
from runtime.cli.help import EXAMPLES, GROUPS, first_sentence, plain_ranges
from runtime.cli.output import say_json
from runtime.errors import InfantError

COMMAND: Any = typer.main.get_command(cli.app)


def ended(monkeypatch: pytest.MonkeyPatch, *words: str) -> object:
    """Exit code of `infant` with these words."""
    monkeypatch.setattr(sys, "argv", ["infant", *words])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code


def test_every_command_is_in_a_group_and_has_an_example() -> None:
    grouped = {name for names in GROUPS.values() for name in names}
    assert set(COMMAND.commands) <= grouped
    for name, command in COMMAND.commands.items():
        for inner in getattr(command, "commands", {"": None}):
            assert f"{name} {inner}".strip() in EXAMPLES


@pytest.mark.parametrize("line", [line for lines in EXAMPLES.values() for line in lines])
def test_an_example_is_a_line_that_the_command_takes(line: str) -> None:
    words = shlex.split(line.removeprefix("sudo "))[1:]
    if words[0] not in COMMAND.commands:
        pytest.skip(f"{words[0]} is not there yet")
    command = COMMAND
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    command.make_context(command.name, words)


def test_the_help_lists_whole_sentences_by_task() -> None:
    text = CliRunner().invoke(cli.app, ["--help"]).output
    places = [text.index(f"{title}:") for title in GROUPS]
    assert places == sorted(places)
    assert "..." not in text.partition("Options:")[2]
    assert first_sentence("One thing: two.\nStill one. Then more.") == "One thing: two. Still one".partition(". ")[0]


def test_the_version_is_printed() -> None:
    shown = CliRunner().invoke(cli.app, ["--version"])
    assert (shown.exit_code, shown.output.split()[0]) == (0, "infant")


@pytest.mark.parametrize(
    ("words", "code", "reason"),
    [
        (("check", "--config", "nowhere.toml", "--json"), 3, "nowhere.toml: cannot be read"),
        (("check", "--confg", "mock", "--json"), 2, "No such option"),
        (("chek", "--json"), 2, "chek"),
        (("config", "--json"), 2, "give exactly one of --defaults"),
        (
            ("setup", "--yes", "--tread", "0.4", "--json"),
            2,
            "if it is behind): missing; measure",
        ),
    ],
)
def test_an_error_is_one_json_object_for_a_program(
    words: tuple[str, ...], code: int, reason: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(monkeypatch, *words) == code
    said = capsys.readouterr()
    error = json.loads(said.out)["error"]
    assert error["exit_code"] == code
    assert reason in error["reason"]
    assert said.err.startswith("infant: ")


def test_a_defect_is_one_json_object_too(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def fail(**_words: object) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(cli, "app", fail)
    assert ended(monkeypatch, "check", "--json") == 70
    assert json.loads(capsys.readouterr().out) == {"error": {"exit_code": 70, "reason": "ZeroDivisionError: a defect"}}


def test_an_answer_is_not_followed_by_a_second_object(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def answer_and_fail(**_words: object) -> None:
        say_json({"result": "FAIL"})
        raise InfantError("no")

    monkeypatch.setattr(cli, "app", answer_and_fail)
    assert ended(monkeypatch, "check", "--json") == 70
    assert json.loads(capsys.readouterr().out) == {"result": "FAIL"}


@pytest.mark.parametrize(
    ("told", "shown"),
    [
        ("cell size, m  [default: 0.1; 0.02<=x<=10.0]", "cell size, m  [default: 0.1; 0.02 to 10]"),
        ("seconds  [1.0<=x<=100000000.0]", "seconds  [at least 1]"),
        ("a name  [required]", "a name  [required]"),
    ],
)
def test_a_range_is_written_as_a_person_writes_it(told: str, shown: str) -> None:
    assert plain_ranges(told) == shown
