"""The simulated rover: one world, a laser and a wheel node that speak the real bytes of it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.canbus.frame import CanFrame
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_world import KidnapSettings, WorldSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.laser.profiles import profile_of
from drivers.simulated.wheels.node import WheelNode
from drivers.simulated.world.places.building import Building
from drivers.simulated.world.places.choose import kidnapped, world_of
from drivers.simulated.world.places.world import World

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


class Hand:
    """Carries the rover away: the fault of the world."""

    def __init__(self, world: World | Building, elapsed_s: Callable[[], float]) -> None:
        self._world = world
        self._elapsed_s = elapsed_s

    def inject(self, fault: KidnapSettings | dict[str, Any]) -> None:
        """Put the rover down elsewhere, start_s from now. Raises pydantic.ValidationError."""
        kidnap = fault if isinstance(fault, KidnapSettings) else KidnapSettings.model_validate(fault)
        at_s = self._elapsed_s() + kidnap.start_s
        self._world.path = kidnapped(self._world.path, kidnap.model_copy(update={"start_s": at_s}))

    def clear(self) -> None:
        """Nothing: a rover that was carried away stands where it was put."""


class Rover:
    """Devices answer from start(); the world stands at its beginning until drive()."""

    def __init__(
        self,
        settings: SimulationSettings,
        encoders: EncoderSettings,
        now_ns: Callable[[], int],
    ) -> None:
        self._world = world_of(world_for(settings))
        self._start_ns: int | None = None
        self._now_ns = now_ns
        self._device = LaserDevice(settings.laser, lambda t_ns: self._world.ranges_at(self._world_ns(t_ns)), now_ns)
        self._node = WheelNode(
            settings.wheels,
            encoders,
            lambda t_ns: self._world.wheel_travel_m(self._world_ns(t_ns)),
            now_ns,
            np.random.default_rng([settings.world.seed, WHEEL_STREAM]),
        )
        self._encoders = encoders.model_copy(update={"bus": self._node.bus})

    @property
    def world(self) -> World | Building:
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
    def devices(self) -> dict[str, "LaserDevice | WheelNode | Hand"]:
        """Both devices by name, and the hand that carries the rover away."""
        return {"laser": self._device, "wheels": self._node, "world": Hand(self._world, self._elapsed_s)}

    def tap(self, laser: Callable[[bytes], None], wheels: Callable[[CanFrame], None]) -> None:
        """Who gets what both devices send; before start()."""
        self._device.tap, self._node.tap = laser, wheels

    def start(self) -> None:
        """Begin to answer and to send."""
        self._device.start()
        self._node.start()

    def drive(self, start_ns: int) -> None:
        """Let the world begin at this time."""
        self._start_ns = start_ns

    def inject(self, device: str, fault: dict[str, Any]) -> None:
        """Give a device ("laser", "wheels" or "world") a fault. Raises pydantic.ValidationError, DriverError."""
        self.devices[device].inject(fault)

    def clear(self, device: str) -> None:
        """Take all faults back."""
        self.devices[device].clear()

    def close(self) -> None:
        """Stop both devices."""
        self._node.close()
        self._device.close()

    def _elapsed_s(self) -> float:
        return 0.0 if self._start_ns is None else (self._now_ns() - self._start_ns) * 1e-9

    def _world_ns(self, stamp_ns: int) -> int:
        """Time of the world; far before its beginning until drive(): the rover stands, the noise is alive."""
        return stamp_ns - (FAR_NS if self._start_ns is None else self._start_ns)
