"""Commands on maps: map save, map info, map check, map draw, map merge, map live."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.live import stopping
from runtime.cli.output import answer
from runtime.cli.progress import LONGEST_S, AsJson, progress_bar

Map = Annotated[Path, typer.Argument(metavar="MAP", help="file of a saved map", show_default=False)]

LOCAL_ROVER = "tcp/127.0.0.1:7448"


def save(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run", show_default=False)],
    out: Annotated[Path, typer.Option("--out", metavar="MAP", help="file of the map; never overwritten")],
    origin: Annotated[
        str | None,
        typer.Option("--origin", metavar="LAT,LON[,HEADING]", help="geodetic position where the map begins, degrees"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Replay a run and save the map that it ends with, so that later drives can start in it."""
    from runtime.maps.save import save_lines, save_run

    result = save_run(run, out, progress_bar("save"), origin)
    answer(result, save_lines(result), as_json)


def info(saved: Map, as_json: AsJson = False) -> None:
    """Show what a map holds and where it comes from."""
    from runtime.maps.info import info_lines, map_info

    facts = map_info(saved)
    answer(facts, info_lines(facts), as_json)


def check(
    saved: Map,
    config: Annotated[
        Path | None, typer.Option("--config", help="also say whether a rover with this configuration can use it")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Read and check every byte of a map.

    Exit code 6: it is damaged or not a map; 3: it belongs to another kind of sensor.
    """
    from runtime.maps.info import check_lines, check_map

    result = check_map(saved, config)
    answer(result, check_lines(result), as_json)


def draw(
    source: Annotated[Path, typer.Argument(metavar="RUN|MAP", help="a run or a saved map", show_default=False)],
    grid: Annotated[
        bool, typer.Option("--grid", help="also draw an occupancy grid, from the scans along the path")
    ] = False,
    resolution: Annotated[float, typer.Option(min=0.01, max=10.0, help="cell size of the grid, m")] = 0.05,
    out: Annotated[Path | None, typer.Option("--out", help="folder for the files; default: RUN/map")] = None,
    as_json: AsJson = False,
) -> None:
    """Export a map to other programs: PGM and YAML for nav2's map_server, PNG, landmarks as CSV and GeoJSON."""
    from runtime.maps.draw import draw_lines, draw_map, draw_run

    if source.is_file() and source.suffix != ".mcap":
        result = draw_map(source, out, grid)
    else:
        result = draw_run(source, out, resolution if grid else None, progress_bar("draw"))
    answer(result, draw_lines(result), as_json)


def merge(
    first: Annotated[Path, typer.Argument(metavar="MAP", help="map whose frame is kept", show_default=False)],
    second: Annotated[Path, typer.Argument(metavar="OTHER", help="map that overlaps it", show_default=False)],
    out: Annotated[Path, typer.Option("--out", metavar="BOTH", help="file of the new map; never overwritten")],
    as_json: AsJson = False,
) -> None:
    """Merge two maps where both show the same place. Exit code 2: no such place was recognised."""
    from runtime.maps.merge import merge_files, merge_lines

    result = merge_files(first, second, out)
    answer(result, merge_lines(result), as_json)


def live(
    rover: Annotated[str, typer.Option("--rover", help="name of the rover")],
    connect: Annotated[str, typer.Option("--connect", help="zenoh endpoint of the rover or a router")] = LOCAL_ROVER,
    zenoh_file: Annotated[
        Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate for the router of a fleet")
    ] = None,
    resolution: Annotated[float, typer.Option(min=0.02, max=10.0, help="cell size of the grid, m")] = 0.05,
    duration: Annotated[
        float | None, typer.Option(min=1.0, max=LONGEST_S, help="seconds; default: until Ctrl-C")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Publish the occupancy grid of a running rover once a second on infant/ROVER/grid, from a separate process."""
    from runtime.maps.live_grid import publish_live_grid

    stop = stopping(duration)
    file = None if zenoh_file is None else str(zenoh_file)
    sent = publish_live_grid(connect, rover, resolution, file, stop, sys.stderr)
    answer({"rover": rover, "grids": sent}, (f"grids     {sent} on infant/{rover}/grid",), as_json)


MAP_COMMANDS = (save, info, check, draw, merge, live)
MAP_HELP = "Save, check, draw and merge maps, for later drives and for other programs."
