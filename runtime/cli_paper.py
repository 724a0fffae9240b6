"""The command that reproduces the paper."""

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli_runs import AsJson, progress_bar
from runtime.errors import UsageError


class Part(StrEnum):
    """What of the paper."""

    FIG1 = "fig1"
    FIG2 = "fig2"
    TABLE1 = "table1"
    ABLATION = "ablation"
    FIG5 = "fig5"
    FIG6 = "fig6"
    ALL = "all"


def register(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(paper)


def paper(
    part: Annotated[Part, typer.Argument(help="a figure, the table, the ablation, or all")],
    seeds: Annotated[int, typer.Option("--seeds", min=1, max=1000, help="drives for each arm")] = 20,
    out: Annotated[Path, typer.Option("--out", help="folder for pictures and tables; finished jobs are kept")] = Path(
        "paper"
    ),
    particles: Annotated[int, typer.Option("--particles", min=1, max=10_000, help="particles of every arm")] = 30,
    scheduler: Annotated[
        str, typer.Option("--scheduler", help="address of a dask scheduler, local (all cores), or none")
    ] = "local",
    as_json: AsJson = False,
) -> None:
    """Reproduce the paper's figures with their spread over seeds, and say what holds."""
    from runtime.paper.publish_study import reproduce, study_lines
    from runtime.paper.study import PARTS, Study

    if not scheduler:
        raise UsageError("--scheduler: expected an address such as tcp://10.0.0.1:8786, local, or none")
    parts = PARTS if part is Part.ALL else (part.value,)
    show = progress_bar("paper")
    result = reproduce(
        Study(parts, seeds, particles),
        out,
        None if scheduler == "none" else scheduler,
        lambda done, total: show(done / max(total, 1)),
    )
    typer.echo(json.dumps(result) if as_json else "\n".join(study_lines(result)))
