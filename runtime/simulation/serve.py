"""`infant sim`: the simulated devices alone, for any SCIP or CAN client."""

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

from drivers.settings.simulation import SimulationSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.rover import Rover, world_for
from drivers.simulated.world.world import World
from runtime.errors import ConfigurationError
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.simulation.typed_faults import EXAMPLES, Device, obey_lines


def serve_rover(
    config: Path, overrides: dict[str, str], stop: threading.Event, stream: TextIO, faults: TextIO | None = None
) -> None:
    """Start all devices of a configuration, print where they are, and run until `stop`.

    faults: lines that let something go wrong meanwhile, see typed_faults.py.

    Raises ConfigurationError when the configuration describes no simulated rover.
    """
    configuration = load_configuration(config, overrides)
    if configuration.simulation is None or configuration.encoders is None:
        raise ConfigurationError(f"{config}: needs the tables [simulation] and [encoders]; see config/mock.toml")
    rover = Rover(configuration.simulation, configuration.encoders, time.monotonic_ns)
    rover.start()
    try:
        rover.drive(time.monotonic_ns())
        bus = rover.encoders.bus
        name = f"{bus.interface}:{bus.channel}" + (f":{bus.port}" if bus.port else "")
        stream.write(
            f"laser  {rover.laser_url}  speaks SCIP 2; any client can connect\n"
            f"wheels {name}  CAN frames as python-can has them, INTERFACE:CHANNEL:PORT\n"
            f"try    infant setup --laser {rover.laser_url} --can {name}\n"
        )
        _wait(rover.devices, stop, stream, faults)
    finally:
        rover.close()


def serve_laser(
    config: Path | None, overrides: dict[str, str], stop: threading.Event, stream: TextIO, faults: TextIO | None = None
) -> None:
    """The laser alone, without a bus: the default world, or that of a configuration."""
    configuration = load_configuration_text("", overrides) if config is None else load_configuration(config, overrides)
    simulation = configuration.simulation or SimulationSettings()
    world, start_ns = World(world_for(simulation)), time.monotonic_ns()
    device = LaserDevice(simulation.laser, lambda t_ns: world.ranges_at(t_ns - start_ns), time.monotonic_ns)
    device.start()
    try:
        stream.write(f"laser  {device.url}\n" + (f"laser  {device.pty_url}\n" if device.pty_url else ""))
        _wait({"laser": device}, stop, stream, faults)
    finally:
        device.close()


def _wait(devices: Mapping[str, Device], stop: threading.Event, stream: TextIO, faults: TextIO | None) -> None:
    """Until `stop`, doing what the lines of `faults` say."""

    def say(sentence: str) -> None:
        stream.write(f"{sentence}\n")
        stream.flush()

    if faults is not None:
        say(f"faults one a line, help lists them: {EXAMPLES}")
        obey_lines(faults, devices, say)
    stream.flush()
    stop.wait()
