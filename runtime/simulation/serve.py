"""`infant sim`: the simulated devices alone, for any SCIP or CAN client."""

import math
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from pydantic import ValidationError

from drivers.measurements import DriverError
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.settings.simulated_world import WorldSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.laser.device import LaserDevice
from drivers.simulated.rover import Rover, world_for
from drivers.simulated.world.places.choose import world_of
from runtime.errors import ConfigurationError, UsageError
from runtime.expected_value import expected_value
from runtime.printable import tell
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.simulation.as_configured import simulation_of
from runtime.simulation.sent import SentBytes
from runtime.simulation.typed_faults import EXAMPLES, Device, obey_lines

INTERFACES = Path("/sys/class/net")
ANSWERED_S = 2.0  # in which a line that is being answered has been, unless nobody reads


def serve_rover(
    config: Path,
    overrides: dict[str, str],
    stop: threading.Event,
    stream: TextIO,
    faults: TextIO | None = None,
    record: Path | None = None,
) -> None:
    """Start all devices of a configuration, print where they are, and run until `stop`.

    A file without the table [simulation] is simulated as it describes its rover. faults: lines that let something go
    wrong meanwhile, see typed_faults.py. record: folder that gets what was sent.

    Raises ConfigurationError for a rover that cannot be simulated, UsageError, StorageError.
    """
    simulation, encoders = described(config, overrides)
    with ExitStack() as stack:
        sent = None if record is None else stack.enter_context(SentBytes(record, stop))
        try:
            rover = Rover(simulation, encoders, time.monotonic_ns)
        except DriverError as error:
            raise ConfigurationError(f"{config}: {error}") from error
        stack.callback(rover.close)
        if sent is not None:
            rover.tap(sent.laser, sent.wheels)
        rover.start()
        rover.drive(time.monotonic_ns())
        bus = rover.encoders.bus
        name = f"{bus.interface}:{bus.channel}" + (f":{bus.port}" if bus.port else "")
        tell(
            stream,
            f"laser  {rover.laser_url}  speaks SCIP 2; any client can connect\nwheels {name}  CAN frames "
            f"for python-can, as INTERFACE:CHANNEL:PORT\ntry    infant setup --laser {rover.laser_url} "
            f"--can {name} {_geometry_words(simulation, encoders)}\n",
        )
        _wait(rover.devices, stop, stream, faults)


def _geometry_words(simulation: SimulationSettings, encoders: EncoderSettings) -> str:
    """What a ruler and the data sheet would tell of this rover, as options of `infant setup`."""
    vehicle, laser = encoders.vehicle, simulation.world.laser
    ahead_m, _, yaw_rad = laser.body_from_laser
    words = f"--wheel-radius {vehicle.wheel_radius_left_m:g} --tread {vehicle.tread_m:g} "
    words += f"--counts-per-rev {vehicle.counts_per_rev:g} --laser-ahead {ahead_m:g}"
    words += "".join(f" --reverse {side}" for side in ("left", "right") if getattr(encoders, side).sign < 0)
    return words + " --backwards" * (math.cos(yaw_rad) < 0.0) + " --upside-down" * laser.upside_down


def described(config: Path, overrides: dict[str, str]) -> tuple[SimulationSettings, EncoderSettings]:
    """What to simulate; on a bus of this machine alone where the file's CAN interface is not here."""
    configuration = load_configuration(config)
    if configuration.encoders is None:
        raise ConfigurationError(f"{config}: needs the table [encoders]; see config/mock.toml and config/examples")
    if configuration.simulation is not None:
        simulation = load_configuration(config, overrides).simulation
        assert simulation is not None
        return simulation, configuration.encoders
    simulation, encoders = simulation_of(configuration), configuration.encoders
    words: dict[str, dict[str, str]] = {"world": {}, "laser": {}}
    for key, value in overrides.items():
        words[key.split(".")[1]][key.split(".")[2]] = value
    try:
        laser = SimulatedLaserSettings.model_validate({"model": simulation.laser.model} | words["laser"])
        world = WorldSettings.model_validate(simulation.world.model_dump() | words["world"])
    except ValidationError as error:
        problem = error.errors()[0]
        sentence = f"{problem['loc'][0]} = {problem['input']!r}: expected {expected_value(problem)}"
        raise UsageError(sentence) from error
    if encoders.bus.interface == "socketcan" and not (INTERFACES / encoders.bus.channel).exists():
        encoders = encoders.model_copy(update={"bus": BusSettings()})
    return simulation.model_copy(update={"laser": laser, "world": world}), encoders


def serve_laser(
    config: Path | None, overrides: dict[str, str], stop: threading.Event, stream: TextIO, faults: TextIO | None = None
) -> None:
    """The laser alone, without a bus: the default world, or that of a configuration."""
    configuration = load_configuration_text("", overrides) if config is None else load_configuration(config, overrides)
    simulation = configuration.simulation or SimulationSettings()
    world, start_ns = world_of(world_for(simulation)), time.monotonic_ns()
    device = LaserDevice(simulation.laser, lambda t_ns: world.ranges_at(t_ns - start_ns), time.monotonic_ns)
    device.start()
    try:
        tell(stream, f"laser  {device.url}\n" + (f"laser  {device.pty_url}\n" if device.pty_url else ""))
        _wait({"laser": device}, stop, stream, faults)
    finally:
        device.close()


def _wait(devices: Mapping[str, Device], stop: threading.Event, stream: TextIO, faults: TextIO | None) -> None:
    """Until `stop`, doing what the lines of `faults` say."""
    answering = threading.Lock()

    def say(sentence: str) -> None:
        tell(stream, f"{sentence}\n")

    if faults is not None:
        say(f"type faults, one per line; help lists them: {EXAMPLES}")
        obey_lines(faults, devices, say, answering)
    stop.wait()
    answering.acquire(timeout=ANSWERED_S)  # and kept: Python aborts where a thread still writes when it ends
