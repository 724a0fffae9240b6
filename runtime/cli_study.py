"""Commands that measure the method: bench."""

import json
from dataclasses import asdict
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="one JSON object on standard output and nothing else there")]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(bench)


def bench(as_json: AsJson = False) -> None:
    """Measure the speed of the filter on this machine; CPU times, about two minutes."""
    from runtime.bench.measures import measures

    results = []
    for measure in measures():
        results.append(asdict(measure))
        if not as_json:
            p99 = f"  p99 {measure.p99:g}" if measure.p99 is not None else ""
            typer.echo(f"{measure.name:42s} {measure.value:10g} {measure.unit}{p99}")
    if as_json:
        typer.echo(json.dumps({"results": results}))
