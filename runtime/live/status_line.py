"""The one line that a live run shows, written by a thread of its own: a terminal may stop reading."""

import math
from typing import TextIO

from drivers.stoppable_thread import StoppableThread
from runtime.health import Health
from runtime.printable import coloured, printable, tell
from runtime.tick import CompletedTick, Tick

TERMINAL_PERIOD_S = 0.5
LOG_PERIOD_S = 10.0
LONGEST = 1000  # characters


class StatusLine:
    """Shows the latest tick twice a second on a terminal, and every 10 s as a plain line elsewhere."""

    def __init__(self, stream: TextIO, has_colours: bool = False) -> None:
        """has_colours: the state has a colour where the stream is a terminal."""
        self._stream = stream
        self._has_colours = has_colours
        self._terminal = stream.isatty()
        self._latest: tuple[CompletedTick, Health] | None = None
        self._counted: Tick | None = None
        self._thread = StoppableThread("status-line", self._show)

    def start(self) -> None:
        """Begin to show."""
        self._thread.start()

    def note(self, completed: CompletedTick, health: Health) -> None:
        """The tick to show next; two assignments, so it costs the loop nothing."""
        if self._counted is None:
            self._counted = completed.tick
        self._latest = (completed, health)

    def close(self) -> None:
        """End the line, so that what follows starts on a new one."""
        self._thread.stop(1.0)
        if self._terminal and self._latest is not None:
            self.write("\n")

    def write(self, text: str) -> None:
        """To the stream, where somebody still reads it: a terminal that has gone must not end a run."""
        tell(self._stream, text)

    def announce(self, text: str) -> None:
        """Something to know before the first tick: it takes the line on a terminal, and one of its own elsewhere."""
        self.write(f"\r\x1b[K{text}" if self._terminal else f"{text}\n")

    def _show(self) -> None:
        shown: tuple[CompletedTick, Health] | None = None
        while not self._thread.wait(TERMINAL_PERIOD_S if self._terminal else LOG_PERIOD_S):
            latest = self._latest
            if latest is None or latest is shown:
                continue
            now, before = latest[0].tick, self._counted or latest[0].tick
            rate_hz = (now.seq - before.seq) * 1e9 / max(1, now.stamp_ns - before.stamp_ns)
            text = printable(status_text(*latest, rate_hz), LONGEST)
            text = coloured(text) if self._has_colours and self._terminal else text
            self.write(f"\r\x1b[K{text}" if self._terminal else f"{text}\n")
            shown, self._counted = latest, now


def status_text(completed: CompletedTick, health: Health, rate_hz: float) -> str:
    """Rate, pose, landmarks, lateness and state in one line."""
    tick, estimate, timing = completed.tick, completed.estimate, completed.timing
    pose = estimate.map_from_body
    return (
        f"tick {tick.seq:6d}  {rate_hz:5.2f} Hz  x {pose.x_m:7.2f} m  y {pose.y_m:7.2f} m  "
        f"heading {math.degrees(pose.heading_rad):6.1f} deg  landmarks {int(estimate.counts.get('landmarks', 0)):4d}  "
        f"late {timing.lateness_ns * 1e-6:5.2f} ms  {state_text(health)}"
    )


def state_text(health: Health) -> str:
    """State with its reasons."""
    return f"{health.state} ({'; '.join(health.reasons)})" if health.reasons else str(health.state)
