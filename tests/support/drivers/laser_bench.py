"""A simulated laser and its driver together, for tests over the real wire."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from drivers.laser.hokuyo import Hokuyo
from drivers.measurements import RawTap, Scan
from drivers.settings.laser import LaserSettings
from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.simulated.laser.device import LaserDevice


class NoisyRoom:
    """Ranges around 5 m that are never twice the same; `steps` is set when the model is known."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)
        self.steps = 0
        self.sweeps: list[int] = []

    def ranges_at(self, stamp_ns: int) -> NDArray[np.float64]:
        self.sweeps.append(stamp_ns)
        ranges_m = 5.0 + self._rng.normal(0.0, 0.01, self.steps)
        ranges_m[0] = np.inf
        return ranges_m


@contextmanager
def simulated_laser(settings: SimulatedLaserSettings) -> Iterator[tuple[LaserDevice, NoisyRoom]]:
    room = NoisyRoom()
    device = LaserDevice(settings, room.ranges_at, time.monotonic_ns)
    parameters = device.profile.parameters
    room.steps = parameters.last_step - parameters.first_step + 1
    device.start()
    try:
        yield device, room
    finally:
        device.close()


@contextmanager
def driven(settings: LaserSettings, tap: RawTap | None = None, raw_around_errors: bool = False) -> Iterator[Hokuyo]:
    driver = Hokuyo(settings, time.monotonic_ns, tap, raw_around_errors=raw_around_errors)
    driver.start()
    try:
        yield driver
    finally:
        driver.close()


def wait_for(condition: Callable[[], bool], within_s: float = 600.0) -> float:
    """Seconds until the condition held; fails the test, naming its place, if it does not in time."""
    began = time.monotonic()
    while not condition():
        waited = time.monotonic() - began
        assert waited < within_s, f"not within {within_s} s"
        time.sleep(0.005)
    return time.monotonic() - began


def next_scan(driver: Hokuyo) -> Scan:
    found: list[Scan] = []

    def arrived() -> bool:
        scan = driver.latest()
        if scan is not None:
            found.append(scan)
        return bool(found)

    wait_for(arrived)
    return found[0]
