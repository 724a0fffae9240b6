"""What setup asks, and which answers it takes: an answer that cannot be used is asked for again, or refused at once."""

import json
import math
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from drivers.settings.laser import endpoint
from drivers.settings.vehicle import VehicleSettings
from runtime.errors import ConfigurationError, SensorError, UsageError
from runtime.expected_value import expected_value
from runtime.settings.configuration import load_configuration_text
from slam.settings.slam import MountSettings

KEYS: dict[str, tuple[type[BaseModel], str]] = {
    "--wheel-radius": (VehicleSettings, "wheel_radius_left_m"),
    "--tread": (VehicleSettings, "tread_m"),
    "--counts-per-rev": (VehicleSettings, "counts_per_rev"),
    "--laser-ahead": (MountSettings, "x_m"),
}
"""The key of the configuration that bounds the answer, by option."""
WHEELS = {"left": ("left",), "right": ("right",), "both": ("left", "right"), "none": ()}
REVERSED = "wheels whose counts fall when the rover drives forward: left, right, both or none [none]"
LASER = "address of the laser, tcp://HOST:PORT or serial:///dev/NAME"
BUS = "CAN bus, for example can0"
DBC = "DBC of the wheels, from their maker: path of the file"

Found = TypeVar("Found")
Ask = Callable[[str], str]


def measure(option: str, text: str | float) -> float:
    """A number that can be true of a rover. Raises UsageError with what was expected."""
    model, key = KEYS[option]
    field = model.model_fields[key]
    limited: Any = Annotated[(float, *field.metadata)]
    try:
        value = float(TypeAdapter(limited).validate_python(text))
    except ValidationError as error:
        raise UsageError(f"{option} {text}: expected {expected_value(error.errors()[0])}") from error
    if not math.isfinite(value):
        raise UsageError(f"{option} {text}: expected a finite number")
    return value


def yes_or_no(text: str) -> bool:
    """Raises UsageError where it is neither."""
    word = text.strip().lower()
    if word not in ("y", "yes", "n", "no", ""):
        raise UsageError(f"{text}: expected y for yes or n for no")
    return word.startswith("y")


def reversed_wheels(text: str) -> tuple[str, ...]:
    """Wheels whose counts fall when the rover drives forward. Raises UsageError for another word."""
    word = text.strip().lower() or "none"
    if word not in WHEELS:
        raise UsageError(f"{text}: expected {', '.join(WHEELS)}")
    return WHEELS[word]


def laser_url(text: str) -> str:
    """An address at which a laser can be. Raises UsageError."""
    try:
        endpoint(text)
    except ValueError as error:
        raise UsageError(f"--laser {text}: expected {error}") from error
    return text


def rover_name(text: str) -> str:
    """A name that the keys of the network can have. Raises UsageError."""
    try:
        load_configuration_text(f"rover = {json.dumps(text)}")
    except ConfigurationError as error:
        raise UsageError(f"--rover {text}: expected 1 to 32 letters, digits, '-' and '_'") from error
    return text


def until_found(
    find: Callable[[str | None], Found],
    first: str | None,
    question: str,
    ask: Ask | None,
    say: Callable[[str], None],
) -> Found:
    """What `find` finds; where it finds nothing, a person may answer. ask: None where nobody is there.

    Raises what `find` raises, SensorError or UsageError, where there is nobody to ask.
    """
    answer = first
    while True:
        try:
            return find(answer)
        except (SensorError, UsageError) as error:
            if ask is None:
                raise
            say(str(error))
            answer = ask(question)
