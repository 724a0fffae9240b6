"""Commands that print the runtime's figures: quality of the pose, rate of the loop, what hours leave behind."""

import json
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli_paper import Scheduler, chosen_scheduler, job_progress

AsJson = Annotated[bool, typer.Option("--json", help="one JSON object on standard output and nothing else there")]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(quality)
    app.command()(rate)
    app.command()(soak)


def quality(
    runs: Annotated[int, typer.Option(min=1, max=10_000, help="kidnapped drives, and as many blinded ones")] = 100,
    hours: Annotated[float, typer.Option(min=0.2, max=1000.0, help="of undisturbed driving among people")] = 3.0,
    particles: Annotated[int, typer.Option("--particles", min=1, max=10_000, help="particles of the filter")] = 100,
    calibration: Annotated[
        bool, typer.Option("--calibration", help="drives on which the bounds were chosen, not those that judge them")
    ] = False,
    out: Annotated[Path, typer.Option("--out", help="folder for the curve; finished drives are kept")] = Path(
        "quality"
    ),
    scheduler: Scheduler = "none",
    as_json: AsJson = False,
) -> None:
    """How often a kidnapped or blinded rover says that it is lost, and how often one says so that is not."""
    from runtime.quality import study as studies
    from slam.estimator import Estimator

    Estimator.warm_up()
    first_seed = studies.CALIBRATION_SEED if calibration else studies.EVALUATION_SEED
    size = studies.StudySize(runs, hours, particles, first_seed)
    outcome = studies.study(size, out, studies.code_name(), chosen_scheduler(scheduler), job_progress("quality"))
    typer.echo(json.dumps(outcome) if as_json else "\n".join(studies.study_lines(outcome)))


def rate(
    config: Annotated[Path, typer.Option("--config", help="what to run")] = Path("config/mock.toml"),
    minutes: Annotated[float, typer.Option(min=0.05, max=1440.0, help="length of the run")] = 10.0,
    hogs: Annotated[int, typer.Option(min=0, max=64, help="busy processes beside it")] = 2,
    fsync: Annotated[bool, typer.Option("--fsync/--no-fsync", help="a loop of fsync on the same disk")] = True,
    privileges: Annotated[
        bool, typer.Option("--privileges/--no-privileges", help="real-time priority and locked memory")
    ] = True,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="overrides one key")] = None,
    as_json: AsJson = False,
) -> None:
    """Run beside busy neighbours and print how the loop kept its rate, and how long each stage took."""
    from runtime.rate import measure_rate, rate_lines

    measured = measure_rate(config, minutes, hogs, fsync, privileges, set_ or [])
    typer.echo(json.dumps(measured) if as_json else "\n".join(rate_lines(measured)))


def soak(
    config: Annotated[Path, typer.Option("--config", help="what to run; a simulated rover")] = Path("config/mock.toml"),
    minutes: Annotated[
        float, typer.Option(min=0.01, max=1440.0, help="how long it takes where the computer keeps up")
    ] = 30.0,
    speed: Annotated[float, typer.Option(min=0.5, max=100.0, help="times faster than life, at most")] = 10.0,
    out: Annotated[Path | None, typer.Option("--out", help="folder that keeps the run; absent: none is kept")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="overrides one key")] = None,
    as_json: AsJson = False,
) -> None:
    """Drive for hours by a clock that skips sleep; print growth of memory, leaked descriptors and missed beats."""
    from runtime.cli_live import stop_on_signals
    from runtime.soak.soak import soak as drive_long
    from runtime.soak.soak import soak_lines

    stop = stop_on_signals()
    with tempfile.TemporaryDirectory(prefix="infant-soak-", dir=Path.cwd()) as name:
        measured = drive_long(config, minutes, speed, out or Path(name), set_ or [], stop, sys.stderr)
    typer.echo(json.dumps(measured) if as_json else "\n".join(soak_lines(measured)))
