"""One drive of the real loop, by a clock that skips sleep: what a configuration makes of a simulated rover's wires."""

import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.settings.simulation import SimulationSettings
from runtime.live.clock import Clock
from runtime.live.parts import Parts, live_parts
from runtime.live.run import Host, run_live
from runtime.record.folder import RunFolder
from runtime.service.systemd import ServiceManager
from runtime.settings.configuration import Configuration
from runtime.studies.soak.clock import LeapingClock
from runtime.studies.soak.rover import SteppedRover

SPEED = 100.0  # times life's pace, at most
HAND_OVER_S = 3.0  # in which the drivers of a busy computer have taken a scan


def stepped_drive(
    configuration: Configuration, simulation: SimulationSettings, seconds: float, out: Path
) -> dict[str, Any]:
    """Drive and return the summary of the run, which is kept in `out`; nothing is published or drawn, or ever late.

    configuration: what the runtime believes; its addresses are replaced by those of the simulated devices.
    simulation: what is true. Raises SensorError, StorageError, ConfigurationError.
    """
    assert configuration.laser is not None
    assert configuration.encoders is not None
    clock = LeapingClock(SPEED, lambda deadline_ns, leap: rover.live_until(deadline_ns, leap), work_takes_time=False)
    rover = SteppedRover(simulation, configuration.laser, configuration.encoders, clock.now_ns, HAND_OVER_S)
    try:
        wired = configuration.model_copy(
            update={
                "laser": rover.laser,
                "encoders": rover.encoders,
                "simulation": None,
                "loop": configuration.loop.model_copy(update={"priority": 0}),
                "review": configuration.review.model_copy(update={"live": False}),
                "publish": configuration.publish.model_copy(update={"enabled": False}),
            }
        )

        def wire(configuration: Configuration, folder: RunFolder, clock: Clock) -> Parts:
            parts = live_parts(configuration, folder, clock)
            rover.meet(parts.laser, parts.encoders, parts.sinks)
            return replace(parts, rover=rover)

        host = Host(clock, threading.Event(), sys.stderr, ServiceManager(""))
        return run_live(wired, RunFolder.create(out, out.parent), host, seconds, wire)
    finally:
        rover.close()
