"""`infant check --live`: what would make a drive fail, found while someone is still standing beside the rover."""

import os
import resource
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.canbus.frame import CanFrame
from drivers.laser.hokuyo import Hokuyo
from drivers.measurements import DriverError, Encoders, Laser, SensorHealth, SensorState
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.wheels.encoders import CanEncoders
from runtime.errors import ConfigurationError
from runtime.settings.configuration import Configuration
from runtime.setup.check_result import Check, CheckResult
from runtime.setup.discover.can_traffic import traffic_of
from runtime.setup.discover.listen import hear
from runtime.setup.discover.wheel_layouts import layouts_that_fit
from runtime.setup.validation import UNCERTAINTIES, is_set
from runtime.simulation.rover_process import SimulatedRover

POLL_S = 0.1
HEAR_S = 2.0  # of every id, where the wheels are not among them
MOST_IDS = 12  # shown
LISTEN_S = 4.0  # long enough for a start-up and a second of stream
RATE_TOLERANCE = 0.05
BYTES_PER_HOUR = 700e6  # measured: run.mcap 4.2 MB and the live review.rrd 7.4 MB a minute with 1081 beams at 10 Hz
LEAST_HOURS, GOOD_HOURS = 0.5, 4.0
WARM_S = 10.0
EARLIEST_CLOCK_S = 1_735_689_600  # 2025-01-01: a clock before this has not been set


def preflight(configuration: Configuration, tell: Callable[[str], None]) -> Iterator[Check]:
    """Every check in turn; slow ones last. tell: told how far the slowest is.

    Raises ConfigurationError when a sensor is not configured.
    """
    if configuration.laser is None or configuration.encoders is None:
        raise ConfigurationError("[laser] and [encoders]: missing; a live check needs both tables")
    yield Check("configuration", CheckResult.PASS, f"sha256 {configuration.sha256[:12]}")
    yield check_clock(time.time())
    yield check_disk(Path(configuration.record.folder))
    yield check_real_time(configuration.loop.priority)
    yield check_calibration(configuration)
    yield from (check_endpoint(endpoint) for endpoint in configuration.publish.listen)
    yield check_compile_cache(configuration, tell)
    yield from check_sensors(configuration, configuration.laser, configuration.encoders)


def check_clock(wall_s: float) -> Check:
    """A wall clock that was never set makes the date of every run wrong; nothing else depends on it."""
    if wall_s < EARLIEST_CLOCK_S:
        return Check(
            "clock",
            CheckResult.WARN,
            f"the system clock says {time.strftime('%Y-%m-%d', time.gmtime(wall_s))}",
            "set it (timedatectl set-time) or wait for NTP; stamps within a run are monotonic and stay right",
        )
    return Check("clock", CheckResult.PASS, time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(wall_s)))


def check_disk(folder: Path) -> Check:
    """Free space in hours of recording, and whether the folder can be written."""
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not os.access(existing, os.W_OK):
        remedy = "mount it read-write or change record.folder"
        return Check("disk", CheckResult.FAIL, f"{existing} cannot be written", remedy)
    hours = shutil.disk_usage(existing).free / BYTES_PER_HOUR
    reason = f"space for {hours:.1f} hours of recording is free in {existing}"
    if hours < LEAST_HOURS:
        return Check("disk", CheckResult.FAIL, reason, "remove old runs or change record.folder")
    if hours < GOOD_HOURS:
        return Check("disk", CheckResult.WARN, reason, "remove old runs before a long drive")
    return Check("disk", CheckResult.PASS, reason)


def check_real_time(priority: int) -> Check:
    """Whether the loop may have its priority and its locked memory."""
    if priority == 0:
        reason = "loop.priority is 0: no real-time priority is requested"
        return Check("real time", CheckResult.WARN, reason, "set loop.priority = 50 on a rover")
    allowed = max(resource.getrlimit(resource.RLIMIT_RTPRIO)[0], 99 if os.geteuid() == 0 else 0)
    if allowed < priority:
        return Check(
            "real time",
            CheckResult.WARN,
            f"priority {priority} is requested, {allowed} is allowed",
            "run as the service, or set LimitRTPRIO=60; without it ticks can be late under load",
        )
    return Check("real time", CheckResult.PASS, f"priority {priority} is allowed")


def check_calibration(configuration: Configuration) -> Check:
    """Whether the file holds what only a calibration writes."""
    if all(is_set(configuration, key) for key in UNCERTAINTIES):
        return Check("calibration", CheckResult.PASS, "the geometry is calibrated")
    if configuration.simulation is not None:
        return Check("calibration", CheckResult.PASS, "simulated wheels are as designed")
    return Check(
        "calibration",
        CheckResult.WARN,
        "wheel radii or tread are measured by ruler, not calibrated",
        "drive some loops both ways, then: infant calibrate RUN --write FILE",
    )


def check_endpoint(endpoint: str) -> Check:
    """Whether the port that tools expect is free."""
    address, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address.strip("[]"), int(port)))
    except (OSError, ValueError) as error:
        return Check(
            "zenoh",
            CheckResult.WARN,
            f"{endpoint}: {error}",
            "is another rover running here? The next free port is used",
        )
    return Check("zenoh", CheckResult.PASS, f"{endpoint} is free")


def check_compile_cache(configuration: Configuration, tell: Callable[[str], None]) -> Check:
    """Compile or load the kernels now, as a run does; tell: told how far that is."""
    from runtime.live.kernels import load_kernels  # brings numba, half a second that a check of the file does not need

    took_s = load_kernels(configuration.slam, tell, threading.Event())
    how = f"compiled just now, in {took_s:.0f} s; no run compiles them again" if took_s > WARM_S else "there"
    return Check("compile cache", CheckResult.PASS, f"the kernels are {how}")


def check_sensors(configuration: Configuration, laser: LaserSettings, encoders: EncoderSettings) -> Iterator[Check]:
    """Start both drivers, listen for some seconds and judge state and rate."""
    rover, pause = None, threading.Event()
    if configuration.simulation is not None:
        rover = SimulatedRover(configuration.simulation, laser, encoders)
        laser, encoders = rover.laser, rover.encoders
    parts: tuple[Laser, Encoders] = (Hokuyo(laser, time.monotonic_ns), CanEncoders(encoders, time.monotonic_ns))
    try:
        for part in parts:
            part.start()
        for _ in range(round(LISTEN_S / POLL_S)):  # take what comes, as the loop does
            pause.wait(POLL_S)
            parts[0].latest()
            parts[1].drain()
        yield judge_sensor("laser", parts[0].health(), laser.rate_hz)
        judged = judge_sensor("encoders", parts[1].health(), 1000.0 / encoders.period_ms)
        yield judged
        if judged.verdict is CheckResult.FAIL:
            yield check_bus(encoders.bus)
    finally:
        for part in parts:
            part.close()
        if rover is not None:
            rover.close()


def check_bus(bus: BusSettings, listen: Callable[[BusSettings, float], list[CanFrame]] = hear) -> Check:
    """What is heard where the wheels are not: the ids on the bus, and a layout that would fit them."""
    try:
        traffic = traffic_of(listen(bus, HEAR_S))
    except DriverError as error:
        return failed("bus", str(error), "bring the interface up first")
    if not traffic:
        reason = f"nothing was heard on {bus.channel} in {HEAR_S:g} s"
        return Check("bus", CheckResult.FAIL, reason, "check power of the nodes, bit rate and termination")
    reason = f"heard on {bus.channel}: " + "; ".join(
        f"{each.name} ({each.frames} frames)" for each in traffic[:MOST_IDS]
    )
    reason += f"; {len(traffic) - MOST_IDS} more ids" if len(traffic) > MOST_IDS else ""
    fitting = layouts_that_fit(traffic)
    if not fitting:
        return Check("bus", CheckResult.WARN, reason, "compare these ids with those in encoders.layout")
    remedy = f"{fitting[0].name} fits them: 'infant setup' writes a configuration for it"
    return Check("bus", CheckResult.WARN, reason, remedy)


def failed(name: str, sentence: str, otherwise: str) -> Check:
    """FAIL by a sentence of a driver, whose second half is the remedy; otherwise: what to do where it has none."""
    reason, _, remedy = sentence.partition("; ")
    return Check(name, CheckResult.FAIL, reason, remedy or otherwise)


def judge_sensor(name: str, health: SensorHealth, target_hz: float) -> Check:
    """FAIL when nothing usable comes, WARN when the rate or a counter is off."""
    if health.state is not SensorState.FRESH:
        return failed(name, f"{health.state}: {health.reason}", "check power, cable and configuration")
    facts = ", ".join(f"{key} {value}" for key, value in health.facts.items() if value)
    reason = f"{health.rate_hz:.2f} Hz of {target_hz:g}; {facts}"
    if abs(health.rate_hz / target_hz - 1.0) > RATE_TOLERANCE:
        remedy = f"the rate is more than {RATE_TOLERANCE:.0%} off: check the settings of the sensor"
        return Check(name, CheckResult.WARN, reason, remedy)
    if "advice" in health.facts:
        return Check(name, CheckResult.WARN, reason, "change the configuration as advised, or accept it")
    return Check(name, CheckResult.PASS, reason)
