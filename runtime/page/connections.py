"""The connections of the page: so many at most, and none for long that neither asks nor reads."""

import asyncio
import socket
import struct
from collections import Counter
from collections.abc import Iterable

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 250  # two for each of 100 viewers, and some to be told so; a process may have 1024 files
LONGEST_SILENCE_S = 10.0  # before a request is whole
LONGEST_STALL_S = 60.0  # of somebody who does not read what was asked for; a page asks again by itself
RESET = struct.pack("ii", 1, 0)  # of SO_LINGER: do not wait until what was sent has been read
SEND_BUFFER_BYTES = 64 << 10  # in the kernel, which takes megabytes before it says that nobody reads


class BoundedConnection(H11Protocol):
    """A connection of uvicorn that is ended, instead of kept for ever, where its other end says or takes nothing."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Where it is one too many, close one that neither asks nor reads: else they would keep everyone out."""
        super().connection_made(transport)
        if (wire := transport.get_extra_info("socket")) is not None:
            wire.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._end_within(LONGEST_SILENCE_S)
        if len(self.connections) > MOST_CONNECTIONS:
            self._least_useful().cut()

    def cut(self) -> None:
        """End it now. What the other end has not read would else stay in the kernel for minutes."""
        if (wire := self.transport.get_extra_info("socket")) is not None:
            wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        self.transport.abort()
        self.connections.discard(self)  # or it would be the least useful again before the loop comes round

    def _least_useful(self) -> "BoundedConnection":
        """Of the address that has most connections that wait for their other end, the one that ends soonest."""
        waiting = [(each._deadline, each) for each in self.connections if isinstance(each, BoundedConnection)]
        timed = [(timer.when(), each) for timer, each in waiting if timer is not None and each is not self]
        addresses = Counter(each.address for _, each in timed)
        return min(timed, key=lambda one: (-addresses[one[1].address], one[0]), default=(0.0, self))[1]

    @property
    def address(self) -> str:
        """Of the other end, without the port."""
        return self.client[0] if self.client else ""

    def data_received(self, data: bytes) -> None:
        """A byte now and then is no request: only a whole one may take its time to be answered."""
        super().data_received(data)
        if not self._is_asking:
            self._forget_deadline()

    def on_response_complete(self) -> None:
        """The next request, which may have come already."""
        super().on_response_complete()
        if self._is_asking:
            self._end_within(LONGEST_SILENCE_S)

    def pause_writing(self) -> None:
        """The other end does not read."""
        super().pause_writing()
        self._end_within(LONGEST_STALL_S)

    def resume_writing(self) -> None:
        """It has read."""
        super().resume_writing()
        self._forget_deadline()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is to be ended any more."""
        self._forget_deadline()
        super().connection_lost(exc)

    @property
    def _is_asking(self) -> bool:
        """Whether no request is whole."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    def _end_within(self, seconds: float) -> None:
        self._forget_deadline()
        self._deadline = self.loop.call_later(seconds, self.cut)

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


def cut_client(connections: Iterable[object], client: tuple[str, int]) -> None:
    """End the connection whose other end has this address and port."""
    for each in tuple(connections):
        if isinstance(each, BoundedConnection) and each.client == client:
            each.cut()
