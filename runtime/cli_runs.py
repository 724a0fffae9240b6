"""Commands on a recorded run: replay, import, evaluate, review, view."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

AsJson = Annotated[bool, typer.Option("--json", help="one JSON object on standard output and nothing else there")]
Run = Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")]


def register(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(replay)
    app.command("import")(import_)
    app.command()(evaluate)
    app.command()(review)
    app.command()(view)


def replay(
    run: Run,
    config: Annotated[Path | None, typer.Option("--config", help="another configuration than the recorded one")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder for the replayed run; never overwritten")] = None,
    verify: Annotated[bool, typer.Option("--verify", help="compare with the record bit for bit")] = False,
    seed: Annotated[int | None, typer.Option("--seed", help="another seed of the filter")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="overrides one key")] = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="TECHNIQUE", help="difference, sparse, density, existence, exclusivity, range"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run the filter over a recorded run again, as fast as it can."""
    from runtime.replay import replay_run
    from runtime.replay_report import replay_lines

    result = replay_run(run, config, out, verify, replay_overrides(set_, without, seed), progress_bar("replay"))
    typer.echo(json.dumps(result) if as_json else "\n".join(replay_lines(result)))
    if verify and not result["identical"]:
        sys.exit(1)


def replay_overrides(set_: list[str] | None, without: list[str] | None, seed: int | None) -> dict[str, str]:
    """The three ways to change a replay's configuration as one mapping."""
    from runtime import overrides

    changes = overrides.key_values(set_ or []) | overrides.without(without or [])
    if seed is not None:
        changes["seed"] = str(seed)
    return changes
