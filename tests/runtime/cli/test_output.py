"""What a command prints: no text of others moves the cursor, JSON is JSON, and closed streams are no defect."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.cli.live import stop_on_signals
from runtime.cli.output import LONGEST_LINE, MOST_ALIKE, answer, say
from runtime.source_tree import ROOT
from tests.support.runtime.hostile_runs import write_manifest
from tests.support.runtime.seeded_runs import seeded_facts


def test_a_line_stays_one_line_and_json_stays_json(capsys: pytest.CaptureFixture[str]) -> None:
    say("reason \x1b[2J\nFAKE  running", "b\udce4d")
    assert capsys.readouterr().out == "reason \\x1b[2J\\nFAKE  running\nb\\udce4d\n"
    answer({"reason": "\x1b\x7f\n"}, [], as_json=True)
    said = capsys.readouterr().out
    assert said[:-1].isprintable()
    assert json.loads(said) == {"reason": "\x1b\x7f\n"}


def test_a_long_list_is_cut_and_counted_and_what_is_after_it_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    answer({}, ["run       x", *(f"mark      {number}" for number in range(100_000)), "end"], as_json=False)
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "run       x"
    assert said[1 : MOST_ALIKE + 1] == [f"mark      {number}" for number in range(MOST_ALIKE)]
    assert said[MOST_ALIKE + 1 :] == [f"mark      ... and {100_000 - MOST_ALIKE} more; --json shows all", "end"]
    say("x" * 1_000_000)
    assert len(capsys.readouterr().out) < LONGEST_LINE + 100


@pytest.mark.parametrize(("unwanted", "begins"), [({}, b"\x1b[32mPASS\x1b[0m conf"), ({"NO_COLOR": "1"}, b"PASS conf")])
def test_states_have_colours_on_a_terminal_only_and_for_those_who_want_them(
    unwanted: dict[str, str], begins: bytes
) -> None:
    command = [sys.executable, "-m", "runtime.cli", "check", "--config", "mock"]
    ours, terminal = os.openpty()
    subprocess.run(command, stdout=terminal, cwd=ROOT, check=True, env=os.environ | unwanted)
    os.close(terminal)
    with os.fdopen(ours, "rb", buffering=0) as screen:
        assert screen.read(200).startswith(begins)
    assert subprocess.run(command, capture_output=True, cwd=ROOT, check=True).stdout.startswith(b"PASS conf")


def test_streams_that_are_closed_are_no_defect() -> None:
    command = f"exec {sys.executable} -m runtime.cli log info nothing <&- >&- 2>&-"
    ended = subprocess.run(command, shell=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert ended.returncode == 6


@pytest.mark.parametrize(
    ("words", "exit_code"),
    [
        ("--help", 141),
        ("config --defaults", 141),
        ("log info nothing --json", 6),  # its JSON has no reader, and neither has its sentence
        ("run", 2),
    ],
)
def test_a_reader_that_has_gone_leaves_no_traceback_and_hides_no_exit_code(words: str, exit_code: int) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    for stdout, stderr in ((writing, subprocess.PIPE), (writing, writing)):
        command = [sys.executable, "-m", "runtime.cli", *words.split()]
        ended = subprocess.run(command, stdout=stdout, stderr=stderr, cwd=ROOT, check=False)
        assert ended.returncode == exit_code
        assert b"Traceback" not in (ended.stderr or b"")
        assert b"Exception ignored" not in (ended.stderr or b"")
    os.close(writing)


def test_a_hangup_ends_a_run_in_order_unless_it_was_started_to_stay() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT)}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        stop = stop_on_signals()
        signal.raise_signal(signal.SIGHUP)
        assert stop.is_set()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
        stop = stop_on_signals()
        signal.raise_signal(signal.SIGHUP)
        assert not stop.is_set()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_a_replay_proves_nothing_of_a_run_that_is_not_what_was_closed(tmp_path: Path) -> None:
    seeded_facts(tmp_path / "run", 1, duration_s=1.5)
    words = ["replay", "--verify", str(tmp_path / "run")]
    whole = CliRunner().invoke(app, words)
    assert (whole.exit_code, "identical to the record, every bit" in whole.output) == (0, True)
    facts = {"kind": "segment", "name": "run.mcap", "number": 1, "bytes": 1, "sha256": "0" * 64, "ticks": 15}
    write_manifest(tmp_path / "run", {**facts, "first_ns": 0, "last_ns": 1})
    ended = CliRunner().invoke(app, words)
    assert getattr(ended.exception, "exit_code", None) == 6
    assert "identical to the record of what is left" in ended.output
    assert "run.mcap is not as it was when it was closed" in str(ended.exception)
