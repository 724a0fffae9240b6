"""Commands that measure: the speed of the filter, the geometry of a rover."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli_progress import busy

AsJson = Annotated[bool, typer.Option("--json", help="one JSON object on standard output and nothing else there")]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(bench)
    app.command()(calibrate)


def bench(as_json: AsJson = False) -> None:
    """Measure the speed of the filter on this machine; CPU times, two to three minutes."""
    from runtime.bench.measures import measures

    results = []
    for measure in measures():
        results.append(asdict(measure))
        if not as_json:
            p99 = f"  p99 {measure.p99:g}" if measure.p99 is not None else ""
            typer.echo(f"{measure.name:42s} {measure.value:10g} {measure.unit}{p99}")
    if as_json:
        typer.echo(json.dumps({"results": results}))


def calibrate(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="folders of recorded drives")],
    config: Annotated[Path | None, typer.Option("--config", help="start from these values")] = None,
    write: Annotated[Path | None, typer.Option("--write", metavar="FILE", help="new configuration file")] = None,
    as_json: AsJson = False,
) -> None:
    """Find wheel radii, tread, laser mount, latency and noise from ordinary drives, with 95 % intervals."""
    from runtime.calibrate.recorded_drives import calibrate_runs
    from runtime.calibrate.result import calibration_lines
    from runtime.calibrate.write import write_configuration
    from runtime.config import load_configuration

    with busy("calibrate"):
        result, believed = calibrate_runs(runs, None if config is None else load_configuration(config))
    changed = write_configuration(result, believed.text, write) if write is not None else ()
    if as_json:
        typer.echo(json.dumps(result.as_json() | {"written": None if write is None else str(write)}))
        return
    typer.echo("\n".join(calibration_lines(result)))
    if write is not None:
        typer.echo(f"written   {write} ({', '.join(changed) or 'nothing changed'})")
