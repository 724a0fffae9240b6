"""Whatever goes wrong, a program that asked for JSON gets one object with the reason and the exit code."""

import json
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from runtime.cli import __main__ as cli
from runtime.cli.help import plain_type
from runtime.record.check import verify_run
from runtime.source_tree import ROOT
from tests.support.runtime.seeded_runs import seeded_facts
from tests.support.zenoh.wire import free_port


def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*words, name))
        else:
            yield (*words, name), command


COMMANDS = dict(commands(get_command(cli.app)))
NEEDS = {
    words: [
        word
        for parameter in command.params
        if parameter.required or parameter.param_type_name == "argument"
        for word in ((parameter.opts[0], "nowhere") if parameter.param_type_name == "option" else ("nowhere",))
    ]
    for words, command in COMMANDS.items()
}


def said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[dict[str, Any], int, str]:
    """The object, the exit code, and what a person reads of `infant WORDS --json`."""
    monkeypatch.setattr(sys, "argv", ["infant", *words, "--json"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    printed = capsys.readouterr()
    answer: dict[str, Any] = json.loads(printed.out)
    return answer, int(ended.value.code or 0), printed.err


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_says_in_json_why_it_failed(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for more in ("--nonsense",), tuple(NEEDS[words]):
        if not more or (words, more) == (("bench",), ("nowhere",)):
            continue
        answer, exit_code, _ = said(monkeypatch, capsys, *words, *more)
        assert answer["error"]["exit_code"] == exit_code != 0
        assert answer["error"]["reason"]
        assert "Value error" not in answer["error"]["reason"]


def test_an_answer_with_which_a_command_fails_holds_the_error_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    nobody, exit_code, error = said(monkeypatch, capsys, "status", "--connect", f"tcp/127.0.0.1:{free_port()}")
    assert (nobody["rovers"], nobody["error"]["exit_code"], exit_code) == ([], 5, 5)
    assert nobody["error"]["reason"] in error
    seeded_facts(tmp_path / "run", 1, duration_s=1.5)
    (tmp_path / "run" / "run.mcap").write_bytes((tmp_path / "run" / "run.mcap").read_bytes()[:-100])
    assert verify_run(tmp_path / "run").damages
    damaged, exit_code, _ = said(monkeypatch, capsys, "log", "verify", str(tmp_path / "run"))
    assert (damaged["whole"], damaged["error"]["exit_code"], exit_code) == (False, 6, 6)


@pytest.mark.parametrize(("as_json", "printed"), [(True, {"error": {"exit_code": 130}}), (False, None)])
def test_ctrl_c_is_told_in_json_too(
    as_json: bool,
    printed: dict[str, Any] | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def interrupt(_explain: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("runtime.setup.key_facts.explained", interrupt)
    monkeypatch.setattr(sys, "argv", ["infant", "config", "--explain", "seed", *["--json"] * as_json])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 130
    out = capsys.readouterr().out
    assert (json.loads(out)["error"]["exit_code"] if out else None) == (printed and printed["error"]["exit_code"])


def test_a_clash_of_names_is_told_in_json_before_there_is_a_command_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "slam").mkdir()
    (tmp_path / "slam" / "__init__.py").touch()
    (tmp_path / "infant.py").write_text((ROOT / "infant.py").read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["infant", "check", "--json"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(tmp_path / "infant.py"), run_name="__main__")
    assert ended.value.code == 70
    assert "virtual environment of its own" in json.loads(capsys.readouterr().out)["error"]["reason"]


@pytest.mark.parametrize(
    ("words", "plain"),
    [
        ("--duration <float range>", "--duration <number>"),
        ("RUN <list[Path]>", "RUN <path>"),
        ("--reverse <list[left|right]>", "--reverse <left|right>"),
        ("--seed <int>", "--seed <whole number>"),
        ("--out FILE", "--out FILE"),
    ],
)
def test_the_help_names_types_as_a_person_does(words: str, plain: str) -> None:
    assert plain_type(words) == plain


def test_a_value_that_is_refused_is_told_in_plain_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answer, _, _ = said(monkeypatch, capsys, "run", "--config", "mock", "--duration", "-1")
    assert answer["error"]["reason"] == "Invalid value for '--duration': expected at least 0.1"
    answer, _, _ = said(monkeypatch, capsys, "run", "--config", "mock", "--seed", "1.5")
    assert answer["error"]["reason"] == "Invalid value for '--seed': expected a whole number"
    answer, _, _ = said(monkeypatch, capsys, "check", "--config", "mock", "--set", "slam.particles=-5")
    assert "slam.particles = -5: expected at least 1; change it on the command line" in answer["error"]["reason"]


def test_the_usage_names_words_as_they_are_typed() -> None:
    command = [sys.executable, "-m", "runtime.cli", "command", "fly"]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert ended.returncode == 2
    assert "command [OPTIONS] WORD [REASON]\n" in ended.stderr
    assert "Error: Invalid value for 'WORD': 'fly' is not one of 'mark'" in ended.stderr
