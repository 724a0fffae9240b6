"""The simulated rover: one world, a laser and a wheel node that speak the real bytes of it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.laser_settings import LaserSettings
from drivers.simulated.laser_device import LaserDevice
from drivers.simulated.settings import SimulationSettings
from drivers.simulated.wheel_node import WheelNode
from drivers.simulated.world import World
from drivers.wheel_settings import EncoderSettings


class Rover:
    """Devices answer from start(); the world stands at its beginning until drive()."""

    def __init__(
        self,
        settings: SimulationSettings,
        laser: LaserSettings,
        encoders: EncoderSettings,
        now_ns: Callable[[], int],
    ) -> None:
        self._world = World(settings.world)
        self._start_ns: int | None = None
        self._device = LaserDevice(settings.laser, self._ranges_at, now_ns)
        rng = np.random.default_rng([settings.world.seed, 1])
        self._node = WheelNode(settings.wheels, encoders.bus, self._travel_at, now_ns, rng)

    @property
    def laser_url(self) -> str:
        """Where the laser listens."""
        return self._device.url

    @property
    def encoders(self) -> EncoderSettings:
        """The encoders' settings with the bus that the node is really on."""
        return self._encoders

    def start(self) -> None:
        """Begin to answer and to send."""
        self._device.start()
        self._node.start()

    def drive(self, start_ns: int) -> None:
        """Let the world begin at this time."""
        self._start_ns = start_ns

    def inject(self, device: str, fault: dict[str, Any]) -> None:
        """Give a device ("laser" or "wheels") a fault."""
        (self._device if device == "laser" else self._node).inject(fault)

    def clear(self, device: str) -> None:
        """Take all faults back."""
        (self._device if device == "laser" else self._node).clear()

    def close(self) -> None:
        """Stop both devices."""
        self._node.close()
        self._device.close()

    def _world_ns(self, stamp_ns: int) -> int:
        return 0 if self._start_ns is None else max(0, stamp_ns - self._start_ns)
