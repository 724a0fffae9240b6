"""The thread of a driver, which can be told to stop, shows that it is alive, and outlives whatever is raised in it."""

import logging
import threading
import time
import traceback
from collections.abc import Callable

CLOSE_S = 1.9  # a driver closes within 2 s
AGAIN_MIN_S, AGAIN_MAX_S = 0.1, 0.5  # s before a run that failed is begun again; doubles while it fails at once
SOUND_S = 5.0  # a run that lasted so long had not failed at once


class StoppableThread:
    """Runs `run`, which has to return soon after is_stopping() has become True; begins it again where it raises.

    alive: called from the thread at each is_stopping(), so that a watchdog knows that its loop goes on. failed: told
    in one sentence, from the thread, what was raised; it may raise itself, which ends nothing either. Without it the
    sentence goes to the log, which is standard error.
    """

    def __init__(
        self,
        name: str,
        run: Callable[[], None],
        alive: Callable[[], None] = lambda: None,
        failed: Callable[[str], None] | None = None,
    ) -> None:
        self._alive, self._failed, self._run = alive, failed or self._log, run
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name=name, daemon=True)
        self._again_s = 0.5 * AGAIN_MIN_S

    @property
    def was_stopped(self) -> bool:
        """True once stop() was called."""
        return self._stop.is_set()

    def start(self) -> None:
        """Begin to run."""
        self._thread.start()

    def is_alive(self) -> bool:
        """True from start() until the thread has returned."""
        return self._thread.is_alive()

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

    def _supervise(self) -> None:
        """Run until it returns or is stopped; what another thread raises in this one may come at any line."""
        while not self._stop.is_set():
            try:
                if self._has_run():
                    return
            except BaseException:  # noqa: BLE001, S112 raised while the one before was being told
                continue

    def _has_run(self) -> bool:
        """Run once; False where that raised, which was told, after a wait."""
        began_s = time.monotonic()
        try:
            self._run()
        except BaseException as error:  # noqa: BLE001 a driver's thread ends when it is told to, and by nothing else
            if self._stop.is_set():
                return True
            at_once = time.monotonic() - began_s < SOUND_S
            self._again_s = min(2.0 * self._again_s, AGAIN_MAX_S) if at_once else AGAIN_MIN_S
            try:
                self._failed(told(error))
            finally:  # where telling fails too, it must not begin anew at once for ever
                self._stop.wait(self._again_s)
            return False
        return True

    def _log(self, what: str) -> None:
        logging.getLogger(__name__).error("the thread %s failed and is restarted: %s", self._thread.name, what)


def told(error: BaseException) -> str:
    """A defect in one line: what was raised, and where."""
    place = traceback.format_tb(error.__traceback__)[-1:] or ["in no line of it"]
    return " ".join(f"{error!r} {place[0]}".split())
