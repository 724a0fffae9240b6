"""Sweeps of the simulated laser, cast by a process of its own one ahead of need: the world is a function of time.

`python -m runtime.studies.soak.scans_ahead`: settings as one line of JSON come in, then times, 8 bytes each;
ranges go out.
"""

import struct
import subprocess
import sys
from typing import IO

import numpy as np
from numpy.typing import NDArray

from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.choose import world_of
from runtime.errors import SensorError

TIME = struct.Struct("<q")
SAME_NS = 1000  # sweeps begin on a grid that is rounded to whole nanoseconds
LONGEST_STEP_NS = 1_000_000_000
STOP_S = 3.0


class ScansAhead:
    """Ranges of sweeps at times that follow each other evenly; what was not foreseen is cast while the caller waits."""

    def __init__(self, settings: WorldSettings) -> None:
        self._bytes = 8 * settings.laser.beam_count
        self._child = subprocess.Popen(
            [sys.executable, "-m", "runtime.studies.soak.scans_ahead"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the parent
        )
        self._ordered_ns: int | None = None
        self._last_ns: int | None = None
        self._to_child().write(settings.model_dump_json().encode() + b"\n")

    def at(self, t_ns: int) -> NDArray[np.float64]:
        """(beam_count,) m of the sweep that begins at this time of the world, to a microsecond. Raises SensorError."""
        ranges_m = None
        if self._ordered_ns is not None:
            ordered_ns, ranges_m = self._ordered_ns, self._fetch()
            if abs(ordered_ns - t_ns) > SAME_NS:
                ranges_m = None
        if ranges_m is None:
            self._order(t_ns)
            ranges_m = self._fetch()
        if self._last_ns is not None and 0 < t_ns - self._last_ns <= LONGEST_STEP_NS:
            self._order(2 * t_ns - self._last_ns)
        self._last_ns = t_ns
        return ranges_m

    def close(self) -> None:
        """End the child."""
        self._to_child().close()
        try:
            self._child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def _order(self, t_ns: int) -> None:
        self._ordered_ns = t_ns
        stream = self._to_child()
        stream.write(TIME.pack(t_ns))
        stream.flush()

    def _fetch(self) -> NDArray[np.float64]:
        self._ordered_ns = None
        assert self._child.stdout is not None
        data = self._child.stdout.read(self._bytes)
        if len(data) < self._bytes:
            raise SensorError("the process that casts the sweeps has ended by itself; its message is printed above")
        return np.frombuffer(data, np.float64)

    def _to_child(self) -> IO[bytes]:
        assert self._child.stdin is not None
        return self._child.stdin


def serve(orders: IO[bytes], answers: IO[bytes]) -> None:
    """Cast what is asked for until the orders end."""
    world = world_of(WorldSettings.model_validate_json(orders.readline()))
    while len(order := orders.read(TIME.size)) == TIME.size:
        answers.write(world.ranges_at(TIME.unpack(order)[0]).astype(np.float64).tobytes())
        answers.flush()


if __name__ == "__main__":
    serve(sys.stdin.buffer, sys.stdout.buffer)
