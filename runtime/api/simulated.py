"""Simulated devices for other people's tests: real bytes over TCP and CAN, and faults by method call."""

import time
from typing import Any, Protocol, Self

from drivers.settings.can import BusSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.rover import Rover
from drivers.simulated.wheels.node import WheelNode
from runtime.errors import UsageError
from runtime.settings.configuration import Configuration
from slam.pose import Pose2


class Device(Protocol):
    """What both devices can do."""

    def inject(self, fault: Any) -> None:
        """Begin a fault. Raises pydantic.ValidationError."""

    def clear(self) -> None:
        """End all faults."""


class SimulatedDevice:
    """A device and its faults."""

    def __init__(self, device: Device) -> None:
        self._device = device

    def fail(self, fault: str, **parameters: Any) -> None:
        """Begin a fault, as typed at `infant sim`: fail("silence", duration_s=2). Raises pydantic.ValidationError."""
        self._device.inject({"kind": fault, **parameters})

    def recover(self) -> None:
        """End all faults."""
        self._device.clear()


class SimulatedLaser(SimulatedDevice):
    """Speaks SCIP 2; url: where, as a driver takes it."""

    def __init__(self, device: LaserDevice) -> None:
        super().__init__(device)
        self.url = device.url


class SimulatedWheels(SimulatedDevice):
    """Speak CAN; bus: where, as python-can takes it."""

    def __init__(self, node: WheelNode, bus: BusSettings) -> None:
        super().__init__(node)
        self.bus = bus


class SimulatedRover:
    """A laser and wheels in one world, which stands still until drive().

    configuration: with the addresses of both devices filled in, as a driver or Infant itself takes it.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Raises UsageError where the configuration simulates no rover, LinkError where a port is taken."""
        if configuration.simulation is None or configuration.laser is None or configuration.encoders is None:
            raise UsageError("a simulated rover needs the tables [simulation], [laser] and [encoders]")
        self._rover = Rover(configuration.simulation, configuration.encoders, time.monotonic_ns)
        self._rover.start()
        self._world = self._rover.world
        self._start_ns: int | None = None
        devices = self._rover.devices
        laser, wheels = devices["laser"], devices["wheels"]
        assert isinstance(laser, LaserDevice)
        assert isinstance(wheels, WheelNode)
        self.laser = SimulatedLaser(laser)
        self.wheels = SimulatedWheels(wheels, self._rover.encoders.bus)
        self.configuration = configuration.model_copy(
            update={
                "laser": configuration.laser.model_copy(update={"url": laser.url}),
                "encoders": self._rover.encoders,
                "simulation": None,
            }
        )

    def drive(self) -> None:
        """Begin the course: first its rest, then the drive."""
        self._start_ns = time.monotonic_ns()
        self._rover.drive(self._start_ns)

    def true_pose(self, stamp_ns: int) -> Pose2:
        """Where the rover is at a time of the monotonic clock: map_from_body, the origin until it drives."""
        elapsed_ns = 0 if self._start_ns is None else max(0, stamp_ns - self._start_ns)
        return Pose2(*self._world.map_from_body(elapsed_ns))

    def close(self) -> None:
        """Stop both devices."""
        self._rover.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
