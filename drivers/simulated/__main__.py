"""The simulated rover as a program: settings come in on standard input, endpoints go out on standard output.

One JSON object a line. In: {"simulation", "encoders"} once, then {"drive": start_ns},
{"inject": "laser" | "wheels", "fault": {...}} or {"clear": device}. Out: {"laser_url", "encoders"}. The end of
standard input ends the program.
"""

import json
import os
import sys
import time
from typing import Any, TextIO

from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.rover import Rover


def serve(lines: TextIO, answers: TextIO) -> None:
    """Run one rover until the lines end."""
    request = json.loads(lines.readline())
    rover = Rover(
        SimulationSettings.model_validate(request["simulation"]),
        EncoderSettings.model_validate(request["encoders"]),
        time.monotonic_ns,
    )
    rover.start()
    try:
        answers.write(json.dumps({"laser_url": rover.laser_url, "encoders": rover.encoders.model_dump(mode="json")}))
        answers.write("\n")
        answers.flush()
        for line in lines:
            obey(rover, json.loads(line))
    finally:
        rover.close()


def obey(rover: Rover, request: dict[str, Any]) -> None:
    """Carry out one line."""
    match request:
        case {"drive": start_ns}:
            rover.drive(start_ns)
        case {"inject": device, "fault": fault}:
            rover.inject(device, fault)
        case {"clear": device}:
            rover.clear(device)


if __name__ == "__main__":
    try:
        serve(sys.stdin, sys.stdout)
    except BrokenPipeError:  # whoever started it has gone; what is still held back goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
