"""The simulated rover as users start it, and other commands beside it, each in a process of its own."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from runtime.errors import SensorError
from runtime.publish.find_rover import find_rover
from runtime.source_tree import ROOT
from tests.support.zenoh.wire import until


@contextmanager
def driving(folder: Path, endpoint: str) -> Iterator[None]:
    """From its first tick on; it listens at the endpoint and is recorded in folder/run."""
    text = (ROOT / "config" / "mock.toml").read_text()
    (folder / "rover.toml").write_text(f'{text}\n[publish]\nlisten = ["{endpoint}"]\nconnect = []\n')
    with started("run", "--config", str(folder / "rover.toml"), "--duration", "900", "--out", str(folder / "run")):
        assert until(lambda: (folder / "run" / "run.mcap").exists() and answers(endpoint)), "no first tick"
        yield


def answers(endpoint: str) -> bool:
    """Whether a rover is found there."""
    try:
        return find_rover(endpoint, None).name == "mock"
    except SensorError:
        return False


@contextmanager
def started(*words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A command that has to last until it is ended from here."""
    command = [sys.executable, "-m", "runtime.cli", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
            assert process.poll() is None, f"{words} ended by itself"
        finally:
            process.send_signal(signal.SIGTERM)
