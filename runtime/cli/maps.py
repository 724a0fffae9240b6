"""Commands on maps: map draw."""

import json
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.progress import AsJson, progress_bar


def draw(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run", show_default=False)],
    grid: Annotated[bool, typer.Option("--grid", help="also an occupancy grid, from the scans along the path")] = False,
    resolution: Annotated[float, typer.Option(min=0.01, max=10.0, help="size of a cell of the grid, m")] = 0.05,
    out: Annotated[Path | None, typer.Option("--out", help="folder of the files; default: RUN/map")] = None,
    as_json: AsJson = False,
) -> None:
    """Write a map for others: PGM and YAML of nav2's map_server, PNG, landmarks as CSV and GeoJSON."""
    from runtime.maps.draw import draw_lines, draw_run

    result = draw_run(run, out, resolution if grid else None, progress_bar("draw"))
    typer.echo(json.dumps(result) if as_json else "\n".join(draw_lines(result)))


MAP_COMMANDS = (draw,)
MAP_HELP = "A map in files, for another drive or for other programs."
