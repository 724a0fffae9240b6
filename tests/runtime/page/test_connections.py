"""A connection that says nothing, or reads nothing, is not kept; nor are too many."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="uvicorn is not installed; make test installs it")
import h11
import uvicorn
from uvicorn.server import ServerState

from runtime.page.connections import LONGEST_SILENCE_S, LONGEST_STALL_S, MOST_CONNECTIONS, BoundedConnection

ASKED = b"GET / HTTP/1.1\r\nhost: x\r\n\r\n"


class HandLoop:
    """An event loop whose clock is moved by hand; tasks do not run: nothing is answered."""

    def __init__(self) -> None:
        self.now_s, self.timers = 0.0, list[tuple[float, Callable[[], None], Any]]()

    def call_later(self, seconds: float, call: Callable[[], None]) -> Any:
        handle = asyncio.TimerHandle(self.now_s + seconds, call, (), asyncio.new_event_loop())
        self.timers.append((self.now_s + seconds, call, handle))
        return handle

    def create_task(self, coroutine: Any) -> Any:
        coroutine.close()
        return asyncio.Future(loop=asyncio.new_event_loop())

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds
        due = [timer for timer in self.timers if timer[0] <= self.now_s]
        self.timers = [timer for timer in self.timers if timer not in due]
        for _, call, handle in due:
            if not handle.cancelled():
                call()


class Wire(asyncio.Transport):
    """Nothing behind it."""

    def __init__(self, address: str) -> None:
        super().__init__({"peername": (address, 4711)})
        self.is_ended = False

    def abort(self) -> None:
        self.is_ended = True

    def close(self) -> None:
        self.is_ended = True

    def is_closing(self) -> bool:
        return self.is_ended

    def write(self, data: Any) -> None:
        pass


class Page:
    """A server without an event loop."""

    def __init__(self) -> None:
        async def app(_scope: Any, _receive: Any, _send: Any) -> None:
            pass

        self.loop, self.state = HandLoop(), ServerState()
        self.config = uvicorn.Config(app, http=BoundedConnection, lifespan="off")

    def connected(self, address: str = "192.0.2.1") -> tuple[BoundedConnection, Wire]:
        connection, wire = BoundedConnection(self.config, self.state, {}, self.loop), Wire(address)  # type: ignore[arg-type]
        connection.connection_made(wire)
        return connection, wire


@pytest.mark.parametrize(
    "pieces",
    [[], [ASKED[:1]] * 1, [b"G", b"E", b"T", b" "], [b"POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 9\r\n\r\n"]],
)
def test_who_does_not_ask_to_the_end_is_not_waited_for(pieces: list[bytes]) -> None:
    page = Page()
    connection, wire = page.connected()
    for piece in pieces:
        page.loop.sleep(0.2 * LONGEST_SILENCE_S)
        connection.data_received(piece)
    assert not wire.is_ended
    page.loop.sleep(LONGEST_SILENCE_S)
    assert wire.is_ended


def test_an_answer_may_take_its_time_and_the_next_request_may_not() -> None:
    page = Page()
    connection, wire = page.connected()
    connection.data_received(ASKED)
    page.loop.sleep(1000.0)  # watching
    assert not wire.is_ended
    connection.conn.send(h11.Response(status_code=200, headers=[("content-length", "0")]))
    connection.conn.send(h11.EndOfMessage())
    connection.on_response_complete()
    connection.data_received(b"G")
    page.loop.sleep(LONGEST_SILENCE_S)
    assert wire.is_ended


def test_who_reads_nothing_is_not_kept_and_who_reads_again_is() -> None:
    page = Page()
    connection, wire = page.connected()
    connection.data_received(ASKED)
    connection.pause_writing()
    page.loop.sleep(0.9 * LONGEST_STALL_S)
    connection.resume_writing()
    page.loop.sleep(LONGEST_STALL_S)
    assert not wire.is_ended
    connection.pause_writing()
    page.loop.sleep(LONGEST_STALL_S)
    assert wire.is_ended


def test_where_it_is_one_too_many_the_one_that_has_been_silent_for_longest_goes() -> None:
    page = Page()
    kept = []
    for _ in range(MOST_CONNECTIONS):
        kept.append(page.connected())
        page.loop.sleep(0.5 * LONGEST_SILENCE_S / MOST_CONNECTIONS)
    kept[0][0].data_received(ASKED)  # and is watching
    assert not any(wire.is_ended for _, wire in kept)
    newcomers = [page.connected() for _ in range(3)]
    assert not any(wire.is_ended for _, wire in newcomers)
    assert [wire.is_ended for _, wire in kept] == [False, True, True, True] + [False] * (MOST_CONNECTIONS - 4)


def test_an_address_that_takes_most_loses_its_own() -> None:
    page = Page()
    first, wire = page.connected("198.51.100.1")
    many = [page.connected() for _ in range(2 * MOST_CONNECTIONS)]
    assert not wire.is_ended
    assert sum(not wire.is_ended for _, wire in many) == MOST_CONNECTIONS - 1
    assert first in page.state.connections


def test_where_all_are_watching_one_too_many_is_closed_and_its_place_is_free_again() -> None:
    page = Page()
    kept = [page.connected() for _ in range(MOST_CONNECTIONS)]
    for connection, _ in kept:
        connection.data_received(ASKED)
    _, wire = page.connected()
    assert wire.is_ended
    kept[0][0].connection_lost(None)
    assert not page.connected()[1].is_ended
