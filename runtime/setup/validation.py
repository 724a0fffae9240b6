"""A configuration with which a live run cannot begin is refused before anything is started, with exit code 3."""

from typing import Any

from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import DbcLayout
from runtime.errors import ConfigurationError
from runtime.settings.configuration import Configuration

COMMON_INTERFACES = ("socketcan", "udp_multicast", "slcan", "virtual")
"""Interfaces that python-can has for certain: to look the others up costs a tenth of a second of CPU."""
GEOMETRY = (
    "vehicle.wheel_radius_left_m",
    "vehicle.wheel_radius_right_m",
    "vehicle.tread_m",
    "vehicle.counts_per_rev",
    "slam.mount.x_m",
)
UNCERTAINTIES = ("slam.odometry.radius_uncertainty", "slam.odometry.tread_uncertainty")
"""What a ruler does not give and `infant calibrate` writes."""


def validate_for_live_run(configuration: Configuration, source: str) -> None:
    """Raises ConfigurationError where a live run cannot begin with this; source: the file, for the sentence.

    A sensor that does not answer or an interface that is down is none of these: these come back, and are states.
    """
    for name, table in (("laser", configuration.laser), ("encoders", configuration.encoders)):
        if table is None:
            raise ConfigurationError(f"{source}: {name}: missing; a live run needs the tables [laser] and [encoders]")
    assert configuration.encoders is not None
    interface = configuration.encoders.bus.interface
    if interface not in COMMON_INTERFACES:
        import can

        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise ConfigurationError(f"{source}: encoders.bus.interface = {interface!r}: expected one of {known}")
    _refuse_layout(configuration.encoders, source)
    if configuration.publish.enabled and configuration.publish.config_file is not None:
        from runtime.publish.session import rover_config

        try:
            rover_config(configuration.publish, configuration.rover, ())
        except ConfigurationError as error:
            raise ConfigurationError(f"{source}: {error}") from error
    if configuration.simulation is None and (absent := [key for key in GEOMETRY if not is_set(configuration, key)]):
        raise ConfigurationError(
            f"{source}: {absent[0]}: missing; measure it on the rover: geometry is never guessed ('infant "
            "setup' asks for it)"
        )


def _refuse_layout(encoders: EncoderSettings, source: str) -> None:
    """Where no decoder comes of the layout; that of Infant's own nodes is delivered, with nothing in it to refuse."""
    if encoders.layout == DbcLayout():
        return
    from drivers.wheels.layouts.choose import wheel_decoder  # brings cantools, which brings python-can and asyncio

    try:
        wheel_decoder(encoders)
    except DriverError as error:
        raise ConfigurationError(f"{source}: encoders.layout: {error}") from error


def is_set(configuration: Configuration, key: str) -> bool:
    """Whether the file itself has the key."""
    table: Any = configuration
    for name in key.split("."):
        if name not in table.model_fields_set:
            return False
        table = getattr(table, name)
    return True
