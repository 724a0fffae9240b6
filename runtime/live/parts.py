"""The one place that knows which concrete part stands behind each seam."""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

from drivers.laser.hokuyo import RETRY_MAX_S, Hokuyo
from drivers.measurements import Encoders, Event, Laser, SensorHealth
from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.wheels.encoders import BACKOFF_MAX_S, CanEncoders
from runtime.errors import ConfigurationError
from runtime.live.clock import Clock
from runtime.live.drawing_process import ReviewProcess
from runtime.map_files.start import RunStart
from runtime.publish.publisher import ZenohPublisher
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader, installed_versions
from runtime.record.writing.recorder import Recorder
from runtime.ros2.vehicle import Vehicle
from runtime.service.thread_watch import ThreadWatch
from runtime.settings.configuration import Configuration
from runtime.simulation.rover_process import SimulatedRover
from runtime.tick import Sink
from slam.pose import Pose2


class SimulatedWorld(Protocol):
    """The world of a simulated rover: it begins when the loop does, and knows the truth."""

    def start_world(self, start_ns: int) -> None:
        """Begin at this time of the loop's clock."""

    def map_from_body(self, stamp_ns: int) -> Pose2 | None:
        """The truth; None before it has begun."""

    def close(self) -> None:
        """Release everything."""


@dataclass(frozen=True, slots=True)
class Parts:
    """All that a live run is made of besides the estimator; `close` releases it in the order of the data."""

    laser: Laser
    encoders: Encoders
    sinks: dict[str, Sink]
    recorder: Recorder
    publisher: ZenohPublisher
    rover: SimulatedWorld | None
    threads: ThreadWatch
    drawing: ReviewProcess | None = None

    def start(self) -> None:
        """Begin to connect; nothing waits for a sensor to answer."""
        self.laser.start()
        self.encoders.start()
        self.threads.begin()

    def start_world(self, start_ns: int) -> None:
        """Let a simulated world begin with the loop; a real one has begun long ago."""
        if self.rover is not None:
            self.rover.start_world(start_ns)

    def sensor_health(self) -> dict[str, SensorHealth]:
        """How both sensors are."""
        return {"laser": self.laser.health(), "encoders": self.encoders.health()}

    def drain_events(self) -> tuple[Event, ...]:
        """Commands over zenoh, and threads that hang."""
        return self.publisher.drain_events() + self.threads.drain_events()

    def truth(self, stamp_ns: int) -> Pose2 | None:
        """Where a simulated rover really is."""
        return self.rover.map_from_body(stamp_ns) if self.rover is not None else None

    def close(self, latest_ns: int) -> None:
        """Sensors first, then the sinks, so that everything that came in is written; the picture is given up where it
        takes longer than until latest_ns.
        """
        if self.drawing is not None:
            self.drawing.finish_by(latest_ns * 1e-9)
        self.laser.close()
        self.encoders.close()
        for sink in self.sinks.values():
            sink.close()
        if self.rover is not None:
            self.rover.close()


def live_parts(configuration: Configuration, folder: RunFolder, clock: Clock, start: RunStart | None = None) -> Parts:
    """Drivers and sinks of a live run, not started yet; where one cannot be made the others are closed again.

    start: the map that the run begins in, which its record must hold.

    Raises ConfigurationError when a sensor is not configured, SensorError when the simulation does not start.
    """
    if configuration.laser is None or configuration.encoders is None:
        absent = "laser" if configuration.laser is None else "encoders"
        raise ConfigurationError(f"{absent}: missing; a live run needs the tables [laser] and [encoders]")
    with ExitStack() as made:
        parts = _made_parts(configuration, configuration.laser, configuration.encoders, folder, clock, start, made)
        made.pop_all()  # all is well: closing is now up to the parts
    return parts


def _made_parts(
    configuration: Configuration,
    laser: LaserSettings,
    encoders: EncoderSettings,
    folder: RunFolder,
    clock: Clock,
    start: RunStart | None,
    made: ExitStack,
) -> Parts:
    rover = drawing = None
    if configuration.simulation is not None:
        rover = SimulatedRover(configuration.simulation, laser, encoders)
        made.callback(rover.close)
        laser, encoders = rover.laser, rover.encoders
    if configuration.review.live:
        drawing = ReviewProcess(folder.review_path, configuration.review, configuration.slam.mount)
        made.callback(drawing.close)
    threads = ThreadWatch(clock.now_ns)
    if start is not None:
        start.keep_in(folder)
    began = None if start is None else start.metadata
    header = RunHeader.of_live_run(configuration.text, installed_versions(), began)
    recorder = Recorder(folder, header, configuration.record, [] if drawing is None else [drawing], threads)
    made.callback(recorder.close)
    publisher = ZenohPublisher(
        configuration.publish,
        configuration.rover,
        configuration_text=configuration.text,
        vehicle=Vehicle.of(configuration),
        simulated=configuration.simulation is not None,
    )
    made.callback(publisher.close)
    sinks: dict[str, Sink] = {"record": recorder, "publish": publisher}
    if drawing is not None:
        sinks["review"] = drawing
    tap = recorder if configuration.record.raw else None
    heartbeats = (
        threads.heartbeat("laser", RETRY_MAX_S),
        threads.heartbeat("encoders", BACKOFF_MAX_S),
    )
    around = not configuration.record.raw  # then still the two seconds before and after each error of the laser
    scanner = Hokuyo(laser, clock.now_ns, recorder, alive=heartbeats[0], raw_around_errors=around)
    wheels = CanEncoders(encoders, clock.now_ns, tap, alive=heartbeats[1])
    return Parts(scanner, wheels, sinks, recorder, publisher, rover, threads, drawing)
