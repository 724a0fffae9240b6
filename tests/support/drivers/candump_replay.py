"""A recorded candump sent over a bus again, in its own time or as fast as it goes."""

import threading
from collections.abc import Callable
from pathlib import Path

from drivers.canbus.bus import CanBus
from drivers.canbus.loopback import free_port
from drivers.measurements import LinkError
from drivers.settings.can import BusSettings
from tests.support.drivers.candump import read_candump

STOP_S = 1.5


class CandumpReplay:
    """Takes the place of a WheelNode. speed: 1 for the time of the recording, 0 for as fast as the bus takes it."""

    def __init__(self, path: Path, bus_settings: BusSettings, now_ns: Callable[[], int], speed: float = 1.0) -> None:
        if bus_settings.interface == "udp_multicast" and bus_settings.port == 0:
            bus_settings = bus_settings.model_copy(update={"port": free_port()})
        self.bus = bus_settings
        self.frames_sent = 0
        self.send_errors = 0
        self._path = path
        self._now_ns = now_ns
        self._speed = speed
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._link: CanBus | None = None

    def start(self) -> None:
        """Open the bus and begin to send. Raises LinkError if the bus is not there."""
        self._link = CanBus(self.bus, (), self._now_ns)
        self._thread = threading.Thread(target=self._run, name="candump replay", daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """True once every frame has been sent."""
        assert self._thread is not None
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def close(self) -> None:
        """Stop sending and leave the bus."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(STOP_S)
        if self._link is not None:
            self._link.close()

    def _run(self) -> None:
        assert self._link is not None
        first_ns: int | None = None
        start_ns = self._now_ns()
        for frame in read_candump(self._path):
            first_ns = frame.stamp_ns if first_ns is None else first_ns
            if self._speed > 0.0:
                due_ns = start_ns + round((frame.stamp_ns - first_ns) / self._speed)
                self._stop.wait(max(0.0, (due_ns - self._now_ns()) * 1e-9))
            if self._stop.is_set():
                return
            try:
                self._link.send(frame)
                self.frames_sent += 1
            except LinkError:
                self.send_errors += 1  # lost, as on a real bus
