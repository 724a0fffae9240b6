"""The simulated rover as a program of its own."""

import json
import subprocess
import sys

from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulation import SimulationSettings


def test_a_rover_whose_parent_has_gone_ends_without_a_word() -> None:
    encoders = EncoderSettings(bus=BusSettings(interface="virtual", channel="gone"))
    request = {"simulation": SimulationSettings().model_dump(mode="json"), "encoders": encoders.model_dump(mode="json")}
    process = subprocess.Popen(
        [sys.executable, "-m", "drivers.simulated"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    process.stdin.write(json.dumps(request) + "\n")
    process.stdin.close()
    assert process.stderr.read() == ""
    assert process.wait() == 0
