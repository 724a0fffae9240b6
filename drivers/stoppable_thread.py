"""The thread of a driver, which can be told to stop and shows that it is alive."""

import threading
from collections.abc import Callable

CLOSE_S = 1.9  # a driver closes within 2 s


class StoppableThread:
    """Runs `run` once, which has to return soon after is_stopping() has become True.

    alive: called from the thread at each is_stopping(), so that a watchdog knows that its loop goes on.
    """

    def __init__(self, name: str, run: Callable[[], None], alive: Callable[[], None] = lambda: None) -> None:
        self._alive = alive
        self._stop = threading.Event()
        self._thread = threading.Thread(target=run, name=name, daemon=True)

    @property
    def was_stopped(self) -> bool:
        """True once stop() was called."""
        return self._stop.is_set()

    def start(self) -> None:
        """Begin to run."""
        self._thread.start()

    def is_stopping(self) -> bool:
        """For the thread itself, wherever it waits: True when it has to return."""
        self._alive()
        return self._stop.is_set()

    def wait(self, seconds: float) -> bool:
        """Sleep, for the thread itself; True as soon as it has to return."""
        return self._stop.wait(seconds)

    def stop(self, within_s: float = CLOSE_S) -> None:
        """Have it return; waits for that no longer than within_s. Nothing happens where it was never started."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(within_s)
