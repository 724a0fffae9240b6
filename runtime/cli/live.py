"""Commands around a live rover: run, sim, check, status, warmup."""

import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.begin_in import BeginIn, LocaliseOnly, StartAt
from runtime.cli.output import answer, say, say_json, say_states
from runtime.cli.progress import LONGEST_S, AsJson, busy

Config = Annotated[
    Path, typer.Option("--config", help="TOML file, or the name of a shipped one: mock drives the simulated rover")
]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the run; created, never overwritten")]
Seed = Annotated[int | None, typer.Option("--seed", help="seed of the filter and of the simulated world")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="override one key of the configuration; repeatable"),
]


def run(
    config: Config,
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=LONGEST_S,
            help="seconds for the whole command, with loading, compiling if needed, and closing; "
            "default: a simulated rover drives for 60, a real one until Ctrl-C",
        ),
    ] = None,
    out: Out = None,
    seed: Seed = None,
    set_: Set = None,
    map_: BeginIn = None,
    localise_only: LocaliseOnly = False,
    start_at: StartAt = None,
    as_json: AsJson = False,
) -> None:
    """Run live: read the sensors, publish the pose, record everything. Ctrl-C ends the run and keeps everything."""
    from runtime.errors import Interrupted, SensorError, UsageError
    from runtime.live.clock import MonotonicClock
    from runtime.live.deadline import Deadline, TimeIsOver, process_began_ns
    from runtime.live.run import Host, run_live
    from runtime.live.summary import silence, summary_lines
    from runtime.map_files.start import choose_start
    from runtime.publish.status import named
    from runtime.record.folder import RunFolder
    from runtime.service.systemd import ServiceManager
    from runtime.settings.configuration import load_configuration
    from runtime.settings.overrides import key_values
    from runtime.setup.validation import validate_for_live_run

    overrides = key_values(set_ or [])
    if seed is not None:
        overrides["seed"] = str(seed)
    configuration = load_configuration(config, overrides)
    if configuration.simulation is not None and seed is not None:
        configuration = load_configuration(config, {**overrides, "simulation.world.seed": str(seed)})
    validate_for_live_run(configuration, str(config))
    configuration = named(configuration)
    start = choose_start(map_, localise_only, start_at, configuration)
    for note in () if start is None else start.notes:
        typer.echo(f"infant: {note}", err=True)
    stop, driven_s, deadline = stop_on_signals(), None, Deadline()
    if duration is not None:
        deadline = Deadline.after(duration, process_began_ns())
    elif configuration.simulation is not None:
        driven_s = SIMULATED_DURATION_S
    folder = RunFolder.create(out, Path(configuration.record.folder))
    manager = ServiceManager(os.environ.get("NOTIFY_SOCKET", ""))
    host = Host(MonotonicClock(), stop, sys.stderr, manager, "NO_COLOR" not in os.environ, deadline)
    try:
        summary = run_live(configuration, folder, host, driven_s, start=start)
        if not summary["ticks"] and not stop.is_set():
            raise TimeIsOver
    except TimeIsOver as over:
        folder.remove()
        raise UsageError(f"--duration {duration:g}: was over before the first tick{over}; give more seconds") from None
    as_service = bool(os.environ.get("NOTIFY_SOCKET"))  # systemd would call a service that was stopped a failed one
    if not summary["ticks"]:
        folder.remove()
        if not as_service:
            raise Interrupted("stopped before the first tick; nothing was recorded")
        return
    sentence = "" if as_service else silence(summary, str(config))
    error = SensorError(sentence) if sentence else None
    answer(summary, summary_lines(summary), as_json, error)
    if error is not None:
        raise error


SIMULATED_DURATION_S = 60.0  # from the first tick on


def stopping(duration_s: float | None) -> threading.Event:
    """Set by a signal, or when the time is over."""
    stop = stop_on_signals()
    if duration_s is not None:
        timer = threading.Timer(duration_s, stop.set)
        timer.daemon = True  # what ends earlier does not wait for it
        timer.start()
    return stop


def stop_on_signals() -> threading.Event:
    """An event that Ctrl-C, SIGTERM and a terminal that goes set; only set, so that every sink can close in order."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number is signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
            continue  # whoever started us with nohup wants us to stay
        signal.signal(number, lambda _number, _frame: stop.set())
    return stop


def sim(
    config: Annotated[
        Path | None, typer.Option("--config", help="TOML file, or the name of a shipped one such as mock")
    ] = None,
    laser_only: Annotated[bool, typer.Option("--laser-only", help="simulate only the laser, no CAN bus")] = False,
    model: Annotated[str | None, typer.Option("--model", help="laser model, for example UTM-30LX")] = None,
    listen: Annotated[
        str | None, typer.Option("--listen", metavar="HOST:PORT", help="address at which the laser listens")
    ] = None,
    pty: Annotated[
        str | None, typer.Option("--pty", metavar="PATH", help="also serve a pseudo-terminal, linked from this path")
    ] = None,
    place: Annotated[
        str | None,
        typer.Option("--place", metavar="PLACE", help="where it drives: park, building, corridor, orchard or empty"),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="DIR", help="keep what was sent; infant import DIR makes a run of it"),
    ] = None,
) -> None:
    """Run only the simulated devices, for any SCIP or CAN client to connect to, until Ctrl-C.

    Without a table [simulation], the rover that the file describes is simulated. Type faults on standard input:
    'laser silence duration_s=2', 'wheels slip', 'world kidnap', 'clear laser'; 'help' lists all of them.
    """
    from runtime.errors import UsageError
    from runtime.simulation.serve import serve_laser, serve_rover

    overrides = laser_overrides(model, listen, pty) | ({} if place is None else {"simulation.world.place": place})
    stop = stop_on_signals()
    if laser_only:
        serve_laser(config, overrides, stop, sys.stdout, sys.stdin)
    elif config is None:
        raise UsageError("--config is missing; give a TOML file, a shipped name such as mock, or --laser-only")
    else:
        serve_rover(config, overrides, stop, sys.stdout, sys.stdin, record)


def laser_overrides(model: str | None, listen: str | None, pty: str | None) -> dict[str, str]:
    """Words of `infant sim` as keys of the configuration. Raises UsageError."""
    from runtime.errors import UsageError

    overrides = {}
    if model is not None:
        overrides["simulation.laser.model"] = model
    if pty is not None:
        overrides["simulation.laser.pty"] = pty
    if listen is not None:
        host, colon, port = listen.rpartition(":")
        if not colon or not host or not port.isdigit():
            raise UsageError(f"--listen {listen}: expected HOST:PORT, for example 127.0.0.1:10940")
        overrides |= {"simulation.laser.host": host, "simulation.laser.port": port}
    return overrides


def check(
    config: Config,
    live: Annotated[bool, typer.Option("--live", help="also check devices, disk, clock and privileges")] = False,
    set_: Set = None,
    as_json: AsJson = False,
) -> None:
    """Check a configuration, and with --live the rover itself.

    Exit code 3: the configuration is unusable; 4: a check failed.
    """
    from runtime.errors import PreflightError
    from runtime.settings.configuration import load_configuration
    from runtime.settings.overrides import key_values
    from runtime.setup.check_result import Check, CheckResult, preflight_result
    from runtime.setup.validation import validate_for_live_run

    configuration = load_configuration(config, key_values(set_ or []))
    if configuration.laser is not None and configuration.encoders is not None:  # else it is for recorded data
        validate_for_live_run(configuration, str(config))
    if configuration.map.file is not None:  # loaded here: what reads a map also computes, which takes half a second
        from runtime.map_files.start import choose_start

        choose_start(None, False, None, configuration)  # that it is a map, and of this sensor
    checks: list[Check] = []
    steps = iter([Check("configuration", CheckResult.PASS, str(config))])
    if live:
        from runtime.setup.preflight import preflight  # loads the drivers

        steps = preflight(configuration, lambda line: typer.echo(line, err=True))
    for each in steps:
        checks.append(each)
        if not as_json:
            remedy = f"; {each.remedy}" if each.remedy else ""
            say_states(f"{each.verdict:4s} {each.name:13s} {each.reason}{remedy}")
    failed = ", ".join(each.name for each in checks if each.verdict is CheckResult.FAIL)
    told = "the remedy of each check" if as_json else "the lines above"
    error = PreflightError(f"not ready to drive: {failed}; see {told} for what to do") if failed else None
    if as_json:
        say_json({"config": str(config), "sha256": configuration.sha256} | preflight_result(checks), error)
    if error is not None:
        raise error


def status(
    connect: Annotated[list[str] | None, typer.Option("--connect", help="zenoh endpoint of a rover or router")] = None,
    zenoh_file: Annotated[
        Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate for the router of a fleet")
    ] = None,
    watch: Annotated[bool, typer.Option("--watch", help="repeat every second until Ctrl-C")] = False,
    as_json: AsJson = False,
) -> None:
    """Show the state of every running rover, over zenoh: state, reasons, pose, sensors, outputs."""
    from runtime.errors import SensorError
    from runtime.publish import status as rovers

    ignored: list[str] = []
    endpoints = tuple(connect or rovers.ENDPOINTS)
    file = None if zenoh_file is None else str(zenoh_file)
    if watch:
        answers = rovers.watch_status(endpoints, 1.0, file, ignored.append)
    else:
        answers = iter([rovers.fetch_status(endpoints, config_file=file, refused=ignored.append)])
    is_waiting = False
    for statuses in answers:
        for line in rovers.ignored_lines(ignored):
            say(line, err=True)
        ignored.clear()
        if watch and not statuses and not is_waiting:
            say(f"infant: {rovers.silence_sentence(endpoints)}; waiting until one does", err=True)
        is_waiting = not statuses
        error = None if statuses or watch else SensorError(rovers.silence_sentence(endpoints))
        if as_json:
            say_json({"rovers": statuses}, error)
        elif statuses:
            lines = rovers.status_lines(statuses) if watch else rovers.status_table(statuses)
            say_states(*lines)
        if error is not None:
            raise error


def warmup(as_json: AsJson = False) -> None:
    """Compile the filter once, so that no run waits for it; make and the service do so too."""
    from runtime.live.kernels import mark_complete
    from slam.estimator import Estimator
    from slam.kernel_cache import forget_other_versions, use_compile_cache

    began_s = time.monotonic()
    with busy("compile the kernels of the filter"):
        Estimator.warm_up()
    cache = use_compile_cache(os.environ)
    forget_other_versions(cache)
    mark_complete(cache)
    if as_json:
        say_json({"seconds": round(time.monotonic() - began_s, 3), "cache": str(cache)})


COMMANDS = (run, sim, check, status, warmup)
