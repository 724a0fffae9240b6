"""The page shows what the rover says, to whoever may see it, and nobody who watches holds anything up."""

import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.commands import Command
from runtime.errors import SensorError, UsageError
from runtime.page import rover_state
from runtime.page.hub import Hub
from runtime.page.rover_state import CELL_M, RoverState
from runtime.page.run_list import free_gb, recorded_runs
from runtime.page.serve import ServeOptions, bound_socket, serve_page
from runtime.publish.commands import Answer
from runtime.publish.find_rover import FoundRover
from runtime.publish.follow import Message
from runtime.publish.messages import event_json
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.ros2.laser_scan import scan_bytes
from runtime.ros2.poses import pose_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.source_tree import ROOT
from slam.settings.slam import MountSettings
from tests.support.drivers.raising import raise_in
from tests.support.runtime.drawn_drive import MOUNT, YARD_M, completed_ticks
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

pytest.importorskip("starlette", reason="starlette is not installed; make test installs it")
from runtime.page.server import PageOptions, page_app

WALL_NS = 1_700_000_000_000_000_000
HOST = ("host", "127.0.0.1:8448")


def driven(ticks: int, mount: MountSettings = MOUNT) -> RoverState:
    state = RoverState("r1")
    state.begin(mount)
    for completed in completed_ticks(ticks):
        estimate = completed.estimate
        state.take(Message("pose", pose_bytes(estimate.stamp_ns + WALL_NS, estimate)))
        state.take(Message("scan_full", scan_bytes(completed.tick.scan, WALL_NS, Vehicle())))  # type: ignore[arg-type]
        for event in completed.tick.events:
            state.take(Message("event", event_json(event, WALL_NS)))
    return state


def test_the_scan_is_drawn_where_the_walls_stand() -> None:
    state = driven(30)
    beat = json.loads(json.dumps(state.beat(True), allow_nan=False))
    points = np.array(beat["scan"]).reshape(-1, 2)
    assert np.mean(np.abs(np.abs(points).max(axis=1) - YARD_M) < 0.3) > 0.5
    cells = np.array(state.cells) * CELL_M
    assert np.mean(np.abs(np.abs(cells).max(axis=1) - YARD_M) < 0.5) > 0.4
    assert beat["speed_mps"] == pytest.approx(1.0, abs=0.5)
    assert beat["events"][0]["kind"] == "checksum"
    assert len(beat["scan"]) <= 2 * rover_state.MOST_BEAMS


@pytest.mark.parametrize("name", rover_state.HEARD)
@pytest.mark.parametrize("data", [b"", b"junk", b"\0\1\0\0" + b"\xff" * 400, b"{}", b"[" * 10_000])
def test_what_no_rover_says_changes_nothing(name: str, data: bytes) -> None:
    state = driven(3)
    before = json.dumps(state.beat(True))
    state.take(Message(name, data))
    assert json.dumps(state.beat(True), allow_nan=False) == before


def ask(
    app: Any, path: str, *headers: tuple[str, str], method: str = "GET", body: bytes = b""
) -> tuple[int, dict[str, str], bytes]:
    """One request as a server hands it over; status, headers and body."""
    status, said, parts = 0, {}, []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Any) -> None:
        nonlocal status, said
        if message["type"] == "http.response.start":
            status = message["status"]
            said = {name.decode(): value.decode() for name, value in message["headers"]}
        else:
            parts.append(message.get("body", b""))

    asyncio.run(app(scope_of(path, method, headers), receive, send))
    return status, said, b"".join(parts)


def scope_of(path: str, method: str = "GET", headers: tuple[tuple[str, str], ...] = (HOST,)) -> dict[str, Any]:
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "scheme": "http",
        "client": ("127.0.0.1", 4711),
        "server": ("127.0.0.1", 8448),
        "headers": [(name.encode(), value.encode()) for name, value in headers],
    }


def app_of(tmp_path: Path, command: Callable[[Command, str], Answer] | None = None) -> Any:
    hub = Hub(FoundRover("r1", "tcp/127.0.0.1:1"))
    return page_app(hub, PageOptions(frozenset({"127.0.0.1"}), tmp_path, command))


@pytest.mark.parametrize("path", ["/", "/page.js", "/page.css", "/runs", "/allowed"])
def test_every_answer_forbids_what_comes_from_elsewhere_and_sets_no_cookie(path: str, tmp_path: Path) -> None:
    status, headers, body = ask(app_of(tmp_path), path, HOST)
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "set-cookie" not in headers
    assert not re.search(rb"https?://|<script>|style=|onclick=", body)


def test_another_name_of_the_host_and_too_many_questions_are_refused(tmp_path: Path) -> None:
    app = app_of(tmp_path)
    assert ask(app, "/", ("host", "evil.example"))[0] == 421
    assert ask(app, "/")[0] == 421
    statuses = [ask(app, "/allowed", HOST)[0] for _ in range(60)]
    assert statuses[0] == 200
    assert 429 in statuses


def test_buttons_are_there_only_where_they_are_allowed_and_only_for_the_page_itself(tmp_path: Path) -> None:
    asked: list[tuple[Command, str]] = []

    def command(what: Command, reason: str) -> Answer:
        asked.append((what, reason))
        if what is Command.STOP:
            raise SensorError("r1 does not answer")
        return Answer(True, "")

    mark = json.dumps({"command": "mark", "reason": "a slip"}).encode()
    own = (HOST, ("x-infant", "1"))
    assert ask(app_of(tmp_path), "/command", *own, method="POST", body=mark)[0] == 404
    assert json.loads(ask(app_of(tmp_path), "/allowed", HOST)[2]) == {"commands": False}
    assert ask(app_of(tmp_path, command), "/command", HOST, method="POST", body=mark)[0] == 403
    assert asked == []
    status, _, body = ask(app_of(tmp_path, command), "/command", *own, method="POST", body=mark)
    assert (status, json.loads(body)) == (200, {"accepted": True, "reason": ""})
    assert asked == [(Command.MARK, "a slip")]
    for wrong in (b"junk", b'{"command": "fly", "reason": ""}', b"[]"):
        assert ask(app_of(tmp_path, command), "/command", *own, method="POST", body=wrong)[0] == 400
    save = b'{"command": "save", "reason": ""}'
    assert ask(app_of(tmp_path, command), "/command", *own, method="POST", body=save)[0] == 403
    stop = b'{"command": "stop", "reason": "done"}'
    status, _, body = ask(app_of(tmp_path, command), "/command", *own, method="POST", body=stop)
    assert (status, json.loads(body)["reason"]) == (502, "r1 does not answer")
    assert ask(app_of(tmp_path, command), "/command", *own, method="POST", body=b" " * 100_000)[0] == 413


def test_a_stalled_viewer_holds_up_no_other(tmp_path: Path) -> None:
    app = app_of(tmp_path)

    async def watch() -> list[bytes]:
        never = asyncio.Event()
        heard: list[bytes] = []

        async def receive() -> dict[str, Any]:
            await never.wait()
            return {"type": "http.disconnect"}

        async def stalled(message: Any) -> None:
            if message["type"] == "http.response.body":
                await never.wait()

        async def reads(message: Any) -> None:
            if message["type"] == "http.response.body":
                heard.append(message["body"])

        async def enough(condition: Callable[[], bool]) -> None:
            while not condition():
                await asyncio.sleep(0.01)

        waits: list[Awaitable[None]] = [app(scope_of("/events"), receive, stalled)]
        waits.append(app(scope_of("/events"), receive, reads))
        watching = [asyncio.ensure_future(each) for each in waits]
        await asyncio.wait_for(enough(lambda: len(heard) >= 2), 60.0)
        for task in watching:
            task.cancel()
        await asyncio.gather(*watching, return_exceptions=True)
        return heard

    assert asyncio.run(watch())[0].startswith(b"event: anew")


def test_the_list_of_runs_tells_verdicts_and_what_is_being_recorded(tmp_path: Path) -> None:
    for name in ("20260101T000000Z-a", "20260102T000000Z-b", "20260103T000000Z-c", "no run"):
        (tmp_path / name).mkdir()
    for name in ("20260101T000000Z-a", "20260102T000000Z-b"):
        (tmp_path / name / "run.mcap").write_bytes(b"")
    (tmp_path / "20260101T000000Z-a" / "report.json").write_text('{"verdict": "fine <b>"}')
    recording = RecordFile(tmp_path / "20260103T000000Z-c" / "run.mcap", RunHeader("", "live").metadata)
    found = recorded_runs(tmp_path)
    recording.close()
    assert [(each["name"][-1], each["verdict"]) for each in found] == [
        ("c", "recording"),
        ("b", "not reviewed"),
        ("a", "fine <b>"),
    ]
    assert recorded_runs(tmp_path / "nowhere") == []
    assert free_gb(tmp_path / "nowhere") is None
    assert (free_gb(tmp_path) or 0.0) > 0.0


def test_a_port_in_use_an_address_not_ours_and_open_buttons_are_one_sentence() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(SensorError, match=f"port {port} is in use"):
            bound_socket("127.0.0.1", port)
    with pytest.raises(SensorError, match="not an address of this machine"):
        bound_socket("203.0.113.7", 0)
    with pytest.raises(SensorError, match="is not an address"):
        bound_socket("no such host.invalid", 0)
    with pytest.raises(UsageError, match="leave out --commands"):
        serve_page(ServeOptions(host="0.0.0.0", commands=True), None, None)  # type: ignore[arg-type]  # noqa: S104


def test_whatever_is_raised_in_the_thread_that_hears_the_rover_it_hears_on(caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        hub = Hub(FoundRover("r1", f"tcp/127.0.0.1:{port}"))
        hub.start()
        for times in range(1, 4):
            number = hub._number
            assert until(lambda number=number: hub._number > number, 60.0)  # type: ignore[misc]
            raise_in("rover")
            assert until(lambda times=times: caplog.text.count("the thread rover failed") == times, 60.0)  # type: ignore[misc]
        number = hub._number
        assert until(lambda: hub._number > number, 60.0)
        hub.close()
    assert "OutOfNowhere" in caplog.text


def test_it_ends_quietly_while_somebody_watches() -> None:
    rover_port, port = free_port(), free_port()
    with publishing(settings_on(rover_port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(3), 0.0)
        words = ("page", "--connect", f"tcp/127.0.0.1:{rover_port}", "--port", str(port))
        page = subprocess.Popen(
            [sys.executable, "-m", "runtime.cli", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
        )

        viewers: list[socket.socket] = []

        def watches() -> bool:
            with suppress(OSError):
                viewers.append(socket.create_connection(("127.0.0.1", port), 1.0))
            return bool(viewers)

        assert until(watches, 60.0)
        viewers[0].sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"text/event-stream" in viewers[0].recv(4096)
        page.send_signal(signal.SIGTERM)
        _, said = page.communicate(timeout=60)
        viewers[0].close()
    assert "Traceback" not in said
    assert page.returncode == 0, said
