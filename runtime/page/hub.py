"""Between the thread that hears the rover and the viewers of the page: the newest picture, made once for all."""

import asyncio
import json
import threading
import time
from collections.abc import AsyncIterator, Callable

from drivers.stoppable_thread import StoppableThread
from runtime.errors import ConfigurationError
from runtime.page.rover_state import HEARD, RoverState
from runtime.publish.find_rover import FoundRover
from runtime.publish.follow import Follower, Message, following
from runtime.publish.pace import Pace
from runtime.settings.configuration import load_configuration_text

BEATS_HZ = 5.0
LOOK_S = 0.05  # of a viewer for the next beat, so that it gets all of them
WAKE_S = 0.05
MOST_POINTS = 5000  # of cells and path in one message to one viewer
KEEP_ALIVE_S = 5.0


class Hub:
    """Follows a rover in a thread. A viewer that does not read holds nothing back: it gets the newest when it reads."""

    def __init__(self, rover: FoundRover, config_file: str | None = None) -> None:
        self._rover, self._config_file = rover, config_file
        self._state = RoverState(rover.name)
        self._lock = threading.Lock()
        self._beat, self._number = b"null", 0
        self._thread = StoppableThread("rover", self._run)
        self.is_ending: Callable[[], bool] = lambda: False
        """Whether the server is about to end: then no viewer is kept."""

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._thread.stop(5.0)

    def _run(self) -> None:
        with following(self._rover, HEARD, self._config_file) as follower:
            self._follow(follower)

    def _follow(self, follower: Follower) -> None:
        pace = Pace(BEATS_HZ)
        while not self._thread.is_stopping():
            if follower.has_come():
                self._begin(follower)
            message = follower.next(WAKE_S)
            with self._lock:
                if message is not None:
                    self._state.take(message)
                if pace.due(time.monotonic_ns()):
                    beat = self._state.beat(follower.is_there)
                    self._beat, self._number = json.dumps(beat, allow_nan=False).encode(), self._number + 1

    def _begin(self, follower: Follower) -> None:
        text, path = follower.ask("configuration"), follower.ask("path")
        try:
            source = f"configuration of {follower.rover}"
            mount = load_configuration_text((text or b"").decode(), source=source).slam.mount
        except (ConfigurationError, UnicodeDecodeError):
            return
        with self._lock:
            self._state.begin(mount)
            if path:
                self._state.take(Message("path", path))

    async def messages(self) -> AsyncIterator[bytes]:
        """Server-sent events for one viewer: beat, and the growth of cells and path since the last one."""
        generation, cells, path, number = -1, 0, 0, -1
        idle_s = 0.0
        while not (self._thread.was_stopped or self.is_ending()):
            with self._lock:
                state, beat = self._state, self._beat
                fresh, number = number != self._number, self._number
                if anew := generation != state.generation:
                    generation, cells, path = state.generation, 0, 0
                new_cells = state.cells[cells : cells + MOST_POINTS]
                new_path = state.path[path : path + MOST_POINTS]
            cells, path = cells + len(new_cells), path + len(new_path)
            if anew:
                yield _event("anew", b"{}")
            if new_cells or new_path:
                yield _event("grown", json.dumps({"cells": new_cells, "path": new_path}).encode())
            if fresh:
                yield _event("beat", beat)
            idle_s = 0.0 if fresh else idle_s + LOOK_S
            if idle_s >= KEEP_ALIVE_S:
                idle_s = 0.0
                yield b": still here\n\n"
            await asyncio.sleep(LOOK_S)


def _event(name: str, data: bytes) -> bytes:
    return b"event: " + name.encode() + b"\ndata: " + data + b"\n\n"
