"""Ctrl-C in the middle: a terminal sends it to a command and to all its children at once."""

import ast
import io
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.errors import Interrupted
from runtime.record.folder import RunFolder
from runtime.source_tree import ROOT
from runtime.studies.bench.of_a_run import SMALL_PARENT
from runtime.studies.soak.soak import soak
from tests.runtime.record.test_segments import driven

VIEWERS = {"runtime/live_view/view.py", "runtime/review/viewer.py"}  # programs of others, which end by it


def children() -> dict[str, set[str]]:
    """File and words of every program that is started."""
    found = {}
    for package in ("drivers", "runtime", "slam"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and (
                    ast.unparse(node.func) == "subprocess.Popen"
                    or (ast.unparse(node.func) == "subprocess.run" and "sys.executable" in ast.unparse(node))
                ):
                    words = {ast.unparse(word) for word in node.keywords}
                    found[f"{path.relative_to(ROOT)}:{node.lineno}"] = words
    return found


def test_no_child_of_ours_meets_it_before_it_can_be_ignored() -> None:
    """While a child still imports, Ctrl-C would be a traceback; the parent ends its children itself."""
    started = {name: words for name, words in children().items() if name.partition(":")[0] not in VIEWERS}
    assert len(started) >= 6
    assert [name for name, words in started.items() if "start_new_session=True" not in words] == []


def test_a_half_recovered_run_is_taken_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = driven(tmp_path / "runs" / "run")

    def interrupt(_run: Path, out: RunFolder) -> dict[str, Any]:
        out.write_configuration("")
        raise KeyboardInterrupt

    monkeypatch.setattr("runtime.record.check.recover_run", interrupt)
    result = CliRunner().invoke(app, ["log", "recover", str(run.path), "--out", str(tmp_path / "out")])
    assert result.exit_code in (1, 130)
    assert not (tmp_path / "out").exists()


def test_a_soak_that_is_stopped_before_its_first_tick_has_nothing_to_say(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    with pytest.raises(Interrupted, match="nothing is kept"):
        soak(ROOT / "config" / "mock.toml", 0.1, 10.0, tmp_path, [], stop, io.StringIO())
    assert list(tmp_path.iterdir()) == []


def test_who_measures_a_command_ends_with_it_without_a_word() -> None:
    command = [sys.executable, "-c", SMALL_PARENT, "sh", "-c", "echo here >&2; exec sleep 60"]
    measuring = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert measuring.stderr is not None
    assert measuring.stderr.readline() == "here\n"
    os.killpg(measuring.pid, signal.SIGINT)
    assert measuring.stderr.read() == ""
    assert measuring.wait() == -signal.SIGINT
