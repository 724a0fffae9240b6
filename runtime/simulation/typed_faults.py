"""Faults that a person types at a running `infant sim`: one line each, on its standard input."""

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol, TextIO, get_args

from pydantic import BaseModel, ValidationError

from drivers.measurements import DriverError
from drivers.settings.simulated_laser import LaserFault
from drivers.settings.simulated_wheels import WheelFault
from drivers.settings.simulated_world import KidnapSettings
from runtime.errors import UsageError
from runtime.expected_value import expected_value
from runtime.printable import printable_lines

EXAMPLES = "for example 'laser silence duration_s=2', 'wheels slip share=0.3', 'world kidnap' or 'clear laser'"
FAULTS: dict[str, type[BaseModel]] = {"laser": LaserFault, "wheels": WheelFault, "world": KidnapSettings}


class Device(Protocol):
    """A simulated device as seen from here."""

    def inject(self, fault: Any) -> None:
        """Begin a fault, a LaserFault or a WheelFault."""

    def clear(self) -> None:
        """End all faults."""


def obey_lines(
    lines: TextIO, devices: Mapping[str, Device], say: Callable[[str], object], answering: threading.Lock
) -> threading.Thread:
    """Obey lines from a thread of its own until they end; each is answered by one sentence through `say`.

    answering: held meanwhile; who takes it and keeps it has the last word, as the end of the process needs it.
    """

    def listen() -> None:
        for line in lines:
            if line.strip():
                try:
                    said = obey(line, devices)
                except UsageError as error:
                    said = str(error)
                with answering:
                    say(printable_lines(said))

    thread = threading.Thread(target=listen, name="typed-faults", daemon=True)
    thread.start()
    return thread


def obey(line: str, devices: Mapping[str, Device]) -> str:
    """Carry out 'DEVICE FAULT [KEY=VALUE]...', 'clear DEVICE' or 'help' and tell what was done.

    Raises UsageError for a line that is neither, for a device that is not there and for a fault that does not exist.
    """
    words = line.split()
    if words == ["help"]:
        return "\n".join(fault_lines(devices))
    if words[0] == "clear" and len(words) == 2:
        _known(words[1], devices).clear()
        return f"{words[1]}: no faults"
    if len(words) < 2:
        raise UsageError(f"{line.strip()}: not understood; type a device and a fault, {EXAMPLES}")
    device = _known(words[0], devices)
    model = FAULTS[words[0]]
    fields = {"kind": words[1]} | dict(_key_value(word) for word in words[2:])
    try:
        device.inject(model.model_validate(fields))
    except ValidationError as error:
        raise UsageError("; ".join(_sentence(words[0], problem) for problem in error.errors())) from error
    except DriverError as error:
        raise UsageError(str(error)) from error
    return f"{words[0]}: {' '.join(words[1:])}"


def fault_lines(devices: Iterable[str]) -> list[str]:
    """Every fault of these devices, and the parameters that a fault can have with their defaults."""
    lines = []
    for device in devices:
        model = FAULTS[device]
        annotation: Any = model.model_fields["kind"].annotation
        faults = [str(each) for each in (get_args(annotation) or annotation)]
        lines.append(f"{device} FAULT [KEY=VALUE]...   FAULT: {', '.join(faults)}")
        parameters = ((key, field) for key, field in model.model_fields.items() if key != "kind")
        lines += [f"    {key}={field.default}  {field.description}" for key, field in parameters]
        lines.append(f"clear {device}   end all of its faults")
    return lines


def _known(name: str, devices: Mapping[str, Device]) -> Device:
    if name not in devices:
        raise UsageError(f"{name}: no such device here; expected one of {', '.join(devices)}, {EXAMPLES}")
    return devices[name]


def _key_value(word: str) -> tuple[str, str]:
    key, equals, text = word.partition("=")
    if not key or not equals:
        raise UsageError(f"{word}: expected KEY=VALUE, {EXAMPLES}")
    return key, text


def _sentence(device: str, problem: Any) -> str:
    key = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        known = ", ".join(FAULTS[device].model_fields)
        return f"{device} {key}={problem['input']!r}: unknown key; keys of a fault are {known}"
    return f"{device} {key}={problem['input']!r}: expected {expected_value(problem)}"
