"""`infant sim`: the simulated devices alone, for a desk or another program's client."""

import threading
import time
from pathlib import Path
from typing import TextIO

from drivers.simulated.rover import Rover
from runtime.config import load_configuration
from runtime.errors import ConfigurationError


def serve_desk(config: Path, overrides: dict[str, str], stop: threading.Event, stream: TextIO) -> None:
    """Start the devices of a configuration, print where they are, and run until `stop`."""
    configuration = load_configuration(config, overrides)
    if configuration.simulation is None or configuration.laser is None or configuration.encoders is None:
        raise ConfigurationError(f"{config}: needs the tables [simulation], [laser] and [encoders]; see config/mock.toml")
    rover = Rover(configuration.simulation, configuration.laser, configuration.encoders, time.monotonic_ns)
    rover.start()
    try:
        rover.drive(time.monotonic_ns())
        bus = rover.encoders.bus
        stream.write(f"laser  {rover.laser_url}\nwheels {bus.model_dump_json(exclude_none=True)}\n")
        stream.flush()
        stop.wait()
    finally:
        rover.close()
