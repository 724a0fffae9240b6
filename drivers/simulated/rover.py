"""The simulated rover: one world, a laser and a wheel node that speak the real bytes of it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_world import WorldSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.laser.profiles import profile_of
from drivers.simulated.wheels.node import WheelNode
from drivers.simulated.world.world import World

WHEEL_STREAM = 1  # second word of the seed, so that slip does not repeat the world's own numbers
FAR_NS = 1 << 62  # monotonic stamps are never this late


def world_for(settings: SimulationSettings) -> WorldSettings:
    """The world with the beams of the laser model that looks at it; noise and mount stay as configured."""
    parameters = profile_of(settings.laser).parameters
    first_step, last_step = parameters.first_step, parameters.last_step
    laser = settings.world.laser.model_copy(
        update={
            "beam_count": last_step - first_step + 1,
            "steps_per_revolution": parameters.steps_per_turn,
            "first_bearing_rad": parameters.bearing_rad(first_step),
            "revolution_s": parameters.period_s,
            "range_max_m": min(settings.world.laser.range_max_m, parameters.range_max_mm / 1000.0),
        }
    )
    return settings.world.model_copy(update={"laser": laser})


class Rover:
    """Devices answer from start(); the world stands at its beginning until drive()."""

    def __init__(
        self,
        settings: SimulationSettings,
        encoders: EncoderSettings,
        now_ns: Callable[[], int],
    ) -> None:
        self._world = World(world_for(settings))
        self._start_ns: int | None = None
        self._device = LaserDevice(settings.laser, lambda t_ns: self._world.ranges_at(self._world_ns(t_ns)), now_ns)
        self._node = WheelNode(
            settings.wheels,
            encoders.bus,
            lambda t_ns: self._world.wheel_travel_m(self._world_ns(t_ns)),
            now_ns,
            np.random.default_rng([settings.world.seed, WHEEL_STREAM]),
        )
        self._encoders = encoders.model_copy(update={"bus": self._node.bus})

    @property
    def world(self) -> World:
        """What it drives in; only to be read."""
        return self._world

    @property
    def laser_url(self) -> str:
        """Where the laser listens."""
        return self._device.url

    @property
    def encoders(self) -> EncoderSettings:
        """The encoders' settings with the bus that the node is really on."""
        return self._encoders

    @property
    def devices(self) -> dict[str, LaserDevice | WheelNode]:
        """Both devices by name."""
        return {"laser": self._device, "wheels": self._node}

    def start(self) -> None:
        """Begin to answer and to send."""
        self._device.start()
        self._node.start()

    def drive(self, start_ns: int) -> None:
        """Let the world begin at this time."""
        self._start_ns = start_ns

    def inject(self, device: str, fault: dict[str, Any]) -> None:
        """Give a device ("laser" or "wheels") a fault."""
        self.devices[device].inject(fault)

    def clear(self, device: str) -> None:
        """Take all faults back."""
        self.devices[device].clear()

    def close(self) -> None:
        """Stop both devices."""
        self._node.close()
        self._device.close()

    def _world_ns(self, stamp_ns: int) -> int:
        """Time of the world; far before its beginning until drive(): the rover stands, the noise is alive."""
        return stamp_ns - (FAR_NS if self._start_ns is None else self._start_ns)
