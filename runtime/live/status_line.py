"""The one line that a live run shows, written by a thread of its own: a terminal may stop reading."""

import math
import threading
from typing import TextIO

from runtime.health import Health
from runtime.tick import Tick, Timing
from slam.estimate import Estimate

TERMINAL_PERIOD_S = 0.5
LOG_PERIOD_S = 10.0


class StatusLine:
    """Shows the latest tick twice a second on a terminal, and every 10 s as a plain line elsewhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._terminal = stream.isatty()
        self._latest: tuple[Tick, Estimate, Timing, Health] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._show, name="status-line", daemon=True)

    def start(self) -> None:
        """Begin to show."""
        self._thread.start()

    def note(self, tick: Tick, estimate: Estimate, timing: Timing, health: Health) -> None:
        """The tick to show next; one assignment, so it costs the loop nothing."""
        self._latest = (tick, estimate, timing, health)

    def close(self) -> None:
        """End the line, so that what follows starts on a new one."""
        self._stop.set()
        self._thread.join(1.0)
        if self._terminal and self._latest is not None:
            self._stream.write("\n")

    def _show(self) -> None:
        shown: tuple[Tick, Estimate, Timing, Health] | None = None
        while not self._stop.wait(TERMINAL_PERIOD_S if self._terminal else LOG_PERIOD_S):
            latest = self._latest
            if latest is None or latest is shown:
                continue
            rate_hz = 0.0
            if shown is not None:
                rate_hz = (latest[0].seq - shown[0].seq) * 1e9 / (latest[0].stamp_ns - shown[0].stamp_ns)
            text = status_text(*latest, rate_hz)
            self._stream.write(f"\r\x1b[K{text}" if self._terminal else f"{text}\n")
            self._stream.flush()
            shown = latest


def status_text(tick: Tick, estimate: Estimate, timing: Timing, health: Health, rate_hz: float) -> str:
    """Rate, pose, landmarks, lateness and state in one line."""
    pose = estimate.map_from_body
    reasons = f" ({'; '.join(health.reasons)})" if health.reasons else ""
    return (
        f"tick {tick.seq:6d}  {rate_hz:5.2f} Hz  x {pose.x_m:7.2f} m  y {pose.y_m:7.2f} m  "
        f"heading {math.degrees(pose.heading_rad):6.1f} deg  landmarks {int(estimate.counts.get('landmarks', 0)):4d}  "
        f"late {timing.lateness_ns * 1e-6:5.2f} ms  {health.state}{reasons}"
    )
