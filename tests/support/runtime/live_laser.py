"""A whole live run around a simulated rover in a process of its own, as tests of the laser's faults need it.

The run knows no simulation: its laser and its wheels are endpoints on the wire, as on a real rover.
"""

import io
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from drivers.measurements import Event, SensorHealth
from runtime.live.clock import Clock, MonotonicClock
from runtime.live.parts import Parts, live_parts
from runtime.live.run import Host, run_live
from runtime.messages.recorded_tick import RecordedTick
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from runtime.service.systemd import ServiceManager
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.simulation.rover_process import SimulatedRover

POLL_S = 0.01
CONFIGURATION = """
rover = "faulty"
[slam]
particles = 10
[slam.mount]
x_m = 0.3
[laser]
url = "tcp://127.0.0.1:0"
[encoders.bus]
interface = "udp_multicast"
port = 0
[loop]
priority = 0
[publish]
enabled = false
[review]
live = false
[simulation.world]
seed = 1
"""
UNTOLD = re.compile(r" \(and (\d+) more before\)$")


@dataclass(frozen=True, slots=True)
class LiveRun:
    """What a test holds of a run that goes on in another thread."""

    rover: SimulatedRover
    parts: Parts
    folder: RunFolder
    thread: threading.Thread

    @property
    def laser(self) -> SensorHealth:
        """How the driver is, by its own account."""
        return self.parts.laser.health()

    def count(self, counter: str) -> int:
        """A counter of the driver."""
        return self.laser.counters.get(counter, 0)

    def strike(self, fault: dict[str, Any], counter: str, over_s: float, within_s: float = 600.0) -> float:
        """Inject a fault into a laser at work; returns seconds from its end to the next scan.

        over_s: when it is over, counted from the injection. Asserts that it was counted and that scans come again.
        """
        self.await_more("scans", 4, within_s)
        counted = self.count(counter)
        self.rover.inject("laser", fault)
        end_s = time.monotonic() + over_s
        self.await_more(counter, 1, within_s, counted)
        time.sleep(max(0.0, end_s - time.monotonic()))  # the fault lasts so long: nothing to wait for but time
        self.await_more("scans", 1, within_s)
        return time.monotonic() - end_s

    def await_more(self, counter: str, more: int, within_s: float, since: int | None = None) -> None:
        """Wait until a counter has grown; fails with what the driver says of itself."""
        wanted = (self.count(counter) if since is None else since) + more
        until_s = time.monotonic() + within_s
        while self.count(counter) < wanted:
            assert self.thread.is_alive(), "the run has ended by itself"
            assert time.monotonic() < until_s, f"{counter} not {wanted} within {within_s} s: {self.laser}"
            time.sleep(POLL_S)


@contextmanager
def live_run(path: Path, overrides: dict[str, str] | None = None, shown: TextIO | None = None) -> Iterator[LiveRun]:
    """`infant run` in a thread, driving since its first scan; ended and recorded when the block ends.

    shown: where its status line goes.
    """
    base = load_configuration_text(CONFIGURATION, overrides or {})
    assert base.simulation is not None
    assert base.laser is not None
    assert base.encoders is not None
    rover = SimulatedRover(base.simulation, base.laser, base.encoders)
    configuration = base.model_copy(update={"laser": rover.laser, "encoders": rover.encoders, "simulation": None})
    found: list[Parts] = []
    wired = threading.Event()

    def wire(configuration: Configuration, folder: RunFolder, clock: Clock) -> Parts:
        found.append(live_parts(configuration, folder, clock))
        wired.set()
        return found[0]

    stop, folder = threading.Event(), RunFolder.create(path, path.parent)
    host = Host(MonotonicClock(), stop, shown or io.StringIO(), ServiceManager(""))
    thread = threading.Thread(target=run_live, args=(configuration, folder, host, None, wire))
    thread.start()
    try:
        assert wired.wait(600.0), "the run was not wired"
        run = LiveRun(rover, found[0], folder, thread)
        run.await_more("scans", 1, 600.0)  # kernels may compile first
        rover.start_world(time.monotonic_ns())
        yield run
    finally:
        stop.set()
        thread.join(120.0)
        rover.close()
    assert not thread.is_alive(), "the run did not end"


def recorded(folder: RunFolder) -> list[RecordedTick]:
    """All ticks of a run that has ended."""
    return list(RunReader(folder.path).ticks())


def events_of(ticks: list[RecordedTick], source: str, kind: str | None = None) -> list[Event]:
    """Recorded events of a source."""
    return [
        event
        for recorded_tick in ticks
        for event in recorded_tick.tick.events
        if event.source == source and kind in (None, event.kind)
    ]


def told(events: list[Event]) -> int:
    """How often something happened by what its events say: what comes again within a second is told with the next."""
    return sum(1 + int(found[1]) if (found := UNTOLD.search(event.reason)) else 1 for event in events)


def missed_beats(ticks: list[RecordedTick]) -> int:
    """Beats that were overslept, by the holes in the numbers."""
    return ticks[-1].tick.seq - ticks[0].tick.seq + 1 - len(ticks)
