"""Who watches the page: so many at most, and a newcomer gets the place of whoever makes least use of one."""

import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

MOST_VIEWERS, MOST_OF_ONE_ADDRESS = 100, 50
STALLED_S = 2.0  # ten beats that nobody has read

Client = tuple[str, int]
"""Address and port of the other end."""


@dataclass(eq=False, slots=True)
class Viewer:
    """One stream of events. unread_since_s: when the message began that the other end has not taken yet."""

    client: Client
    since_s: float
    unread_since_s: float | None = None

    def is_stalled(self, now_s: float) -> bool:
        """Whether it has stopped reading."""
        return self.unread_since_s is not None and now_s - self.unread_since_s > STALLED_S


class Viewers:
    """Those who watch: each costs a few kB five times a second. Nobody can hold all places, reading or not."""

    def __init__(
        self,
        messages: Callable[[], AsyncIterator[bytes]],
        end: Callable[[Client], None],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """messages: a new stream of them. end: closes the connection of a client."""
        self._messages, self._end, self._now_s = messages, end, now_s
        self._watching: list[Viewer] = []  # who came first is first

    async def stream(self, request: Request) -> Response:
        """Server-sent events until the viewer goes."""
        client = (request.client.host, request.client.port) if request.client else ("", 0)
        return StreamingResponse(self.watch(client), media_type="text/event-stream")

    async def watch(self, client: Client) -> AsyncIterator[bytes]:
        """The messages for one viewer, who counts from the first one on."""
        self._make_room(client[0])
        viewer = Viewer(client, self._now_s())
        self._watching.append(viewer)
        try:
            async for message in self._messages():
                viewer.unread_since_s = self._now_s()
                yield message
                viewer.unread_since_s = None
        finally:
            self._forget(viewer)

    def _make_room(self, address: str) -> None:
        """End those that are too many: of the newcomer's own address first, then of the one that has most."""
        while self._of(address) and len(self._of(address)) >= MOST_OF_ONE_ADDRESS:
            self._replace(self._of(address))
        while len(self._watching) >= MOST_VIEWERS:
            crowded, _ = Counter(each.client[0] for each in self._watching).most_common(1)[0]
            self._replace(self._of(crowded))

    def _replace(self, viewers: list[Viewer]) -> None:
        """End one that has stopped reading, or else who has watched for longest: a browser asks again by itself."""
        now_s = self._now_s()
        gone = next((each for each in viewers if each.is_stalled(now_s)), viewers[0])
        self._forget(gone)
        self._end(gone.client)

    def _of(self, address: str) -> list[Viewer]:
        return [each for each in self._watching if each.client[0] == address]

    def _forget(self, viewer: Viewer) -> None:
        if viewer in self._watching:
            self._watching.remove(viewer)
