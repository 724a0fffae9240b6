"""The simulated rover, in a process of its own so that it takes nothing from the loop's interpreter."""

import json
import subprocess
import sys
from contextlib import suppress
from typing import Any

from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.settings.simulation import SimulationSettings
from drivers.simulated.world.places.choose import world_of
from runtime.errors import SensorError
from slam.pose import Pose2

STOP_S = 3.0


class SimulatedRover:
    """Starts the devices, tells where they listen, and knows the truth.

    The world stands still until `start_world`; the devices answer from the start. The child ends with its standard
    input, so a killed parent leaves nothing behind.
    """

    def __init__(self, settings: SimulationSettings, laser: LaserSettings, encoders: EncoderSettings) -> None:
        self._world = world_of(settings.world)
        self._start_ns: int | None = None
        self._process = subprocess.Popen(
            [sys.executable, "-m", "drivers.simulated"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the parent, which then ends the child in order
        )
        self._tell(
            {
                "simulation": settings.model_dump(mode="json"),
                "encoders": encoders.model_dump(mode="json"),
            }
        )
        endpoints = self._answer()
        self.laser = laser.model_copy(update={"url": endpoints["laser_url"]})
        self.encoders = EncoderSettings.model_validate(endpoints["encoders"])

    def start_world(self, start_ns: int) -> None:
        """Let the world begin at this monotonic time: first its rest, then its course."""
        self._start_ns = start_ns
        self._tell({"drive": start_ns})

    def inject(self, device: str, fault: dict[str, Any]) -> None:
        """Ask a device ("laser" or "wheels") for a fault."""
        self._tell({"inject": device, "fault": fault})

    def map_from_body(self, stamp_ns: int) -> Pose2 | None:
        """The truth; None before the world has begun."""
        if self._start_ns is None:
            return None
        return Pose2(*self._world.map_from_body(max(0, stamp_ns - self._start_ns)))

    def close(self) -> None:
        """End the child."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):  # the child has ended already, which is what is wanted
            self._process.stdin.close()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def _tell(self, message: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError as error:
            raise SensorError("the simulated rover ended by itself; its message is printed above") from error

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SensorError("the simulated rover did not start; its message is printed above")
        answer: dict[str, Any] = json.loads(line)
        return answer
