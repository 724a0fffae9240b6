"""The server itself, over real sockets, with clients that say nothing, half of it, or do not listen."""

import io
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

pytest.importorskip("uvicorn", reason="uvicorn is not installed; make test installs it")

from runtime.page import connections, hub, server, viewers
from runtime.page.serve import ServeOptions, serve_page
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

MOST, SILENCE_S, STALL_S = 12, 0.6, 0.6
GET = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
WATCH = b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
HALVES = (
    b"",
    b"G",
    b"GET / HTTP/1.1\r\nHost: 127",
    b"\x16\x03\x01\x02\0",
    b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n1",
)


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Of a page that shows a rover, in a hurry: few connections, short patience, fifty beats a second."""
    hurry = {"MOST_CONNECTIONS": MOST, "LONGEST_SILENCE_S": SILENCE_S, "LONGEST_STALL_S": STALL_S}
    for name, value in {**hurry, "SEND_BUFFER_BYTES": 4096}.items():
        monkeypatch.setattr(connections, name, value)
    monkeypatch.setattr(hub, "BEATS_HZ", 50.0)
    monkeypatch.setattr(hub, "LOOK_S", 0.002)
    monkeypatch.setattr(hub, "WAKE_S", 0.002)
    monkeypatch.setattr(server, "REQUESTS_HZ", 1e4)
    rover_port, page_port, stop = free_port(), free_port(), threading.Event()
    options = ServeOptions(port=page_port, connect=f"tcp/127.0.0.1:{rover_port}", runs=tmp_path)
    with publishing(settings_on(rover_port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(5), 0.0)
        serving = threading.Thread(target=serve_page, args=(options, stop, io.StringIO()))
        serving.start()
        try:
            assert until(lambda: is_served(page_port), 60.0)
            put_ticks(publisher, range(5, 30), 0.01)  # what each beat shows from then on
            yield page_port
        finally:
            stop.set()
            serving.join(60.0)
    assert not serving.is_alive()


def connected(port: int, said: bytes = b"", hears: int | None = None) -> socket.socket:
    """A client. hears: its buffer, where it is small."""
    client = socket.socket()
    client.settimeout(30.0)
    if hears is not None:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, hears)
    client.connect(("127.0.0.1", port))
    client.sendall(said)
    return client


def is_served(port: int, said: bytes = GET) -> bool:
    """Whether somebody who asks is answered."""
    with suppress(OSError), closing(connected(port, said)) as client:
        return client.recv(64).startswith(b"HTTP/1.1 200")
    return False


def is_ended(client: socket.socket) -> bool:
    """Whether the other end has gone, read up to there."""
    try:
        while client.recv(1 << 16):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


def test_who_says_nothing_or_half_of_it_is_ended(port: int) -> None:
    with ExitStack() as held:
        clients = [held.enter_context(closing(connected(port, half))) for half in HALVES]
        assert is_served(port)
        assert all(is_ended(client) for client in clients)
        assert is_served(port)


def test_half_a_request_a_byte_at_a_time_is_ended_as_well(port: int) -> None:
    pause = threading.Event()
    with closing(connected(port)) as client:
        ended = False
        for byte in GET[:-1] * 10:
            with suppress(BrokenPipeError, ConnectionResetError):
                client.sendall(bytes((byte,)))
                pause.wait(0.02)
                continue
            ended = True
            break
        assert ended or is_ended(client)
    assert is_served(port)


@pytest.mark.parametrize("half", HALVES[:3])
def test_however_many_are_silent_others_are_served_and_who_watches_goes_on(port: int, half: bytes) -> None:
    with ExitStack() as held:
        viewer = held.enter_context(closing(connected(port, WATCH)))
        assert b"200 OK" in viewer.recv(64)
        for _ in range(6):
            for _ in range(MOST):
                held.enter_context(closing(connected(port, half)))
            assert is_served(port)
        for _ in range(5):
            assert viewer.recv(1 << 16)


def test_who_stops_reading_is_ended_and_another_viewer_hears_on(port: int) -> None:
    with closing(connected(port, WATCH, hears=2048)) as deaf, closing(connected(port, WATCH)) as viewer:
        heard, enough = [0], threading.Event()
        listening = threading.Thread(target=listen, args=(viewer, heard, enough))
        listening.start()
        try:
            assert until(lambda: is_reset(deaf), 30.0)
            before = heard[0]
            assert until(lambda: heard[0] > before + 5, 30.0)
        finally:
            enough.set()
            listening.join(30.0)


def listen(client: socket.socket, heard: list[int], enough: threading.Event) -> None:
    """Count what comes."""
    while not enough.is_set() and client.recv(1 << 16):
        heard[0] += 1


def is_reset(client: socket.socket) -> bool:
    """Whether the other end has cut the connection, without reading anything of it: state CLOSE of TCP."""
    state: int = struct.unpack("B", client.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1))[0]
    return state == 7


@pytest.mark.parametrize("hears", [None, 2048])
def test_however_many_of_one_address_watch_the_next_one_is_let_in(
    port: int, monkeypatch: pytest.MonkeyPatch, hears: int | None
) -> None:
    """hears: the buffer of those who stop reading."""
    monkeypatch.setattr(viewers, "MOST_OF_ONE_ADDRESS", 3)
    monkeypatch.setattr(connections, "LONGEST_STALL_S", 1000.0)
    with ExitStack() as held:
        watching = [held.enter_context(closing(connected(port, WATCH, hears))) for _ in range(3)]
        assert all(each.recv(64).startswith(b"HTTP/1.1 200") for each in watching)
        for _ in range(2):
            assert is_served(port, WATCH)
        newest = held.enter_context(closing(connected(port, WATCH)))
        assert until(lambda: b"event: beat" in newest.recv(1 << 16), 30.0)
        assert until(lambda: any(map(is_reset, watching)), 30.0), "one of them has gone for it"


def test_a_client_that_resets_the_connection_in_the_middle_harms_nobody(port: int) -> None:
    for said in (*HALVES, GET, WATCH):
        for _ in range(10):
            client = connected(port, said)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            client.close()
    assert until(lambda: is_served(port), 10.0), "once those before it have been taken off the queue"
