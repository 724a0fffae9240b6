"""The connections of the page: so many at most, and none for long that neither asks nor reads."""

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 250  # two for each of 100 viewers, and some to be told so; a process may have 1024 files
LONGEST_SILENCE_S = 10.0  # before a request is whole
LONGEST_STALL_S = 60.0  # of somebody who does not read what was asked for; a page asks again by itself


class BoundedConnection(H11Protocol):
    """A connection of uvicorn that is ended, instead of kept for ever, where its other end says or takes nothing."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Close one too many at once."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
        else:
            self._end_within(LONGEST_SILENCE_S)

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
        self._deadline = self.loop.call_later(seconds, self.transport.abort)

    def _forget_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
