"""A real run as its neighbours see it: the service manager, tools over zenoh, the record, and the machine's memory."""

import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import zenoh

from runtime.messages.tick import decode
from runtime.publish.session import tool_config
from runtime.record.reader import RunReader
from runtime.source_tree import ROOT
from tests.support.zenoh.wire import free_port, until

MOCK = ROOT / "config" / "mock.toml"
RESIDENT_MAX_MB = 300.0
NOT_LOADED = ("rerun", "matplotlib", "PIL", "pyarrow")


def start_run(out: Path, *words: str, **environment: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "runtime.cli", "run", "--config", str(MOCK), "--out", str(out), "--json", *words]
    return subprocess.Popen(
        command,
        env={**os.environ, **environment},
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def health_events(run: Path) -> list[str]:
    """Kinds of the health events as they stand in the record, within ticks and after them."""
    diagnostics = [record for record in RunReader(run).records() if record.topic == "/diagnostics"]
    status = [each for record in diagnostics for each in decode(record.topic, record.data).status]
    return [each.hardware_id for each in status if each.name == "health"]


class Neighbours:
    """The service manager and a tool over zenoh, who keep the states that they are told."""

    def __init__(self, folder: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(folder / "notify"))
        self.manager: list[str] = []
        self.thread = threading.Thread(target=self._read_manager, daemon=True)
        self.thread.start()
        self.statuses: list[dict[str, object]] = []
        self.run_messages: list[str] = []
        self.session: zenoh.Session | None = None

    def connect(self, endpoint: str) -> bool:
        try:
            self.session = zenoh.open(tool_config(endpoint))
        except zenoh.ZError:
            return False
        self.session.declare_subscriber("infant/mock/status", self._note_status)
        self.session.declare_subscriber("infant/mock/health", self._note_health)
        return True

    def known_status(self) -> dict[str, object]:
        """The first answer: the session takes connections a moment before it can be asked."""
        assert self.session is not None
        for _ in range(60):
            for reply in self.session.get("infant/mock/status", timeout=2.0):
                if reply.ok is not None:
                    status: dict[str, object] = json.loads(reply.ok.payload.to_bytes())
                    return status
        raise AssertionError("nobody answers infant/mock/status")

    def _read_manager(self) -> None:
        """First words of what `systemctl status` shows; the queue of such a socket is short."""
        while data := self.socket.recv(4096):
            lines = data.decode().splitlines()
            self.manager += [line.removeprefix("STATUS=").split()[0] for line in lines if line.startswith("STATUS=")]

    def close(self) -> None:
        self.socket.shutdown(socket.SHUT_RD)
        self.thread.join(120.0)
        self.socket.close()
        if self.session is not None:
            self.session.close()  # type: ignore[no-untyped-call]

    def _note_status(self, sample: zenoh.Sample) -> None:
        self.statuses.append(json.loads(sample.payload.to_bytes()))

    def _note_health(self, sample: zenoh.Sample) -> None:
        run = decode("/diagnostics", sample.payload.to_bytes()).status[0]
        self.run_messages.append(f"{run.name} {run.message.split(';')[0]}")


def test_everyone_sees_the_run_start_get_ready_run_and_stop(tmp_path: Path) -> None:
    port = free_port()
    neighbours = Neighbours(tmp_path)
    words = ("--duration", "20", "--set", f"publish.listen=['tcp/127.0.0.1:{port}']", "--set", "publish.connect=[]")
    run = start_run(tmp_path / "run", *words, NOTIFY_SOCKET=str(tmp_path / "notify"))
    try:
        assert until(lambda: neighbours.connect(f"tcp/127.0.0.1:{port}"), 600.0)
        asked = neighbours.known_status()
        assert until(lambda: any(status["state"] == "running" for status in neighbours.statuses), 600.0)
        mapped = Path(f"/proc/{run.pid}/maps").read_text()
        printed, errors = run.communicate(timeout=600)
        assert run.returncode == 0, errors
        states = [status["state"] for status in neighbours.statuses]
        assert until(lambda: neighbours.manager[-1:] == ["stopping"]), neighbours.manager
    finally:
        run.kill()
        neighbours.close()
    assert asked["state"] in ("starting", "ready", "running")
    assert asked["pose"] is None or asked["state"] != "starting"
    assert next(state for state in states if state != "starting") == "ready"
    assert states[-1] == "stopping"
    assert {"run ready", "run running", "run stopping"} <= set(neighbours.run_messages)
    assert neighbours.manager[:2] == ["starting", "ready"]
    events = health_events(tmp_path / "run")
    assert events[:2] == ["starting", "ready"]
    assert events[-1] == "stopping"
    loaded = [name for name in NOT_LOADED if f"/{name}" in mapped]
    assert not loaded, f"the loop's process has loaded {loaded}"
    assert json.loads(printed)["resident_mb"] < RESIDENT_MAX_MB


@pytest.fixture
def without_pictures(tmp_path: Path) -> str:
    """A PYTHONPATH on which rerun and matplotlib are absent."""
    (tmp_path / "absent").mkdir()
    (tmp_path / "absent" / "sitecustomize.py").write_text(
        "import sys\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.split('.')[0] in ('rerun', 'matplotlib'):\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
    )
    return f"{tmp_path / 'absent'}:{ROOT}"


def test_where_rerun_is_absent_the_rover_drives_and_says_what_to_install(tmp_path: Path, without_pictures: str) -> None:
    listen = ("--set", "publish.listen=['tcp/127.0.0.1:0']", "--duration", "20")
    for name, live in (("asked", "true"), ("not-asked", "false")):
        run = start_run(tmp_path / name, *listen, "--set", f"review.live={live}", PYTHONPATH=without_pictures)
        _, errors = run.communicate(timeout=600)
        assert run.returncode == 0, errors
    reasons = [event.reason for tick in RunReader(tmp_path / "asked").ticks() for event in tick.tick.events]
    assert any("needs the package rerun" in reason and "pip install rerun-sdk" in reason for reason in reasons), reasons
    quiet = [event.reason for tick in RunReader(tmp_path / "not-asked").ticks() for event in tick.tick.events]
    assert not any("rerun" in reason for reason in quiet)
    for words in (("review", str(tmp_path / "not-asked")), ("paper", "fig1", "--out", str(tmp_path / "paper"))):
        done = subprocess.run(
            [sys.executable, "-m", "runtime.cli", *words],
            env={**os.environ, "PYTHONPATH": without_pictures},
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 2, done.stderr
        assert "pip install" in done.stderr
        assert "Traceback" not in done.stderr
