"""Commands over many seeds: paper, sweep."""

import json
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli_runs import AsJson, progress_bar
from runtime.errors import UsageError

Scheduler = Annotated[str, typer.Option("--scheduler", help="address of a dask scheduler, local (all cores), or none")]


class Part(StrEnum):
    """What of the paper; the published pose is this project's own addition to it."""

    PUBLISHED = "published"
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
    app.command()(sweep)


def paper(
    part: Annotated[Part, typer.Argument(help="a figure, the table, the ablation, the published pose, or all")],
    seeds: Annotated[int, typer.Option("--seeds", min=1, max=1000, help="drives for each arm")] = 20,
    out: Annotated[Path, typer.Option("--out", help="folder for pictures and tables; finished jobs are kept")] = Path(
        "paper"
    ),
    particles: Annotated[int, typer.Option("--particles", min=1, max=10_000, help="particles of every arm")] = 30,
    scheduler: Scheduler = "local",
    as_json: AsJson = False,
) -> None:
    """Reproduce the paper's figures with their spread over seeds, and say what holds."""
    from runtime.paper.publish_study import reproduce, study_lines
    from runtime.paper.study import PARTS, Study

    parts = PARTS if part is Part.ALL else (part.value,)
    result = reproduce(Study(parts, seeds, particles), out, chosen_scheduler(scheduler), job_progress("paper"))
    typer.echo(json.dumps(result) if as_json else "\n".join(study_lines(result)))


def sweep(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="folders of recorded runs")],
    out: Annotated[Path, typer.Option("--out", help="folder for the table; finished jobs are kept")],
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=V1,V2", help="values of one key")] = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, max=1000, help="seeds of the filter, from 1 on")] = 5,
    scheduler: Scheduler = "local",
    as_json: AsJson = False,
) -> None:
    """Replay recorded runs with every combination of settings and seeds; one table as Parquet and CSV."""
    from runtime.paper import sweep as sweeping

    result = sweeping.sweep(runs, set_ or [], seeds, out, chosen_scheduler(scheduler), job_progress("sweep"))
    typer.echo(json.dumps(result) if as_json else f"{result['rows']} rows: {result['csv']}, {result['parquet']}")


def chosen_scheduler(word: str) -> str | None:
    """What run_jobs takes. Raises UsageError on an empty word."""
    if not word:
        raise UsageError("--scheduler: expected an address such as tcp://10.0.0.1:8786, local, or none")
    return None if word == "none" else word


def job_progress(task: str) -> Callable[[int, int], None]:
    """A bar for jobs done of all."""
    show = progress_bar(task)
    return lambda done, total: show(done / max(total, 1))
