"""infant map draw: the map of a run in files that other programs and people can read."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.atomic_write import make_folder, refuse_link, take_away, write_together
from runtime.errors import StorageError, UsageError
from runtime.map_files.confirmed import confirmed
from runtime.map_files.map_store import read_map
from runtime.map_files.start import origin_of
from runtime.maps.grid_files import map_server_yaml, pgm
from runtime.maps.landmark_files import landmark_csv, landmark_geojson
from runtime.maps.picture import map_png, need_pictures
from runtime.maps.placed_scans import PlacedScans
from runtime.record.reader import RunReader
from runtime.record.trajectories import with_estimates
from slam.estimate import LandmarkMap
from slam.maps.occupancy_grid import FREE, OCCUPIED, GridMap, OccupancyGrid

MOST_CELLS = 150_000_000  # 1.2 GB of counts: 390 m by 390 m at 0.05 m without a square left out
SCANS_A_REPORT = 100

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnRun:
    """What a run gives for its map; path_m (n, 2). lost: scans left out because the pose was lost."""

    grid: GridMap | None
    path_m: FloatArray
    landmarks: LandmarkMap | None
    scans: int
    lost: int


def draw_run(run: Path, out: Path | None, resolution_m: float | None, progress: Progress) -> dict[str, Any]:
    """The command; resolution_m None: no grid. Returns its summary.

    Raises UsageError, NotARunError, ConfigurationError, StorageError.
    """
    need_pictures()
    began_s = time.monotonic()
    reader = with_estimates(RunReader(run))
    drawn = read_run(reader, resolution_m, progress)
    if resolution_m is not None and drawn.scans == 0:
        raise UsageError(f"{run} holds no laser scans to make a grid from; leave out --grid to draw its landmarks")
    files: dict[str, str | bytes] = {}
    if drawn.grid is not None:
        files |= {"map.pgm": pgm(drawn.grid), "map.yaml": map_server_yaml(drawn.grid, "map.pgm")}
    landmarks = confirmed(drawn.landmarks)
    origin = origin_of(reader.header, reader.folder)
    files |= {"landmarks.csv": landmark_csv(landmarks), "landmarks.geojson": landmark_geojson(landmarks, origin)}
    files["map.png"] = map_png(drawn.grid, drawn.path_m, landmarks, run.name)
    folder = out or reader.folder.path / "map"
    write_files(folder, files)
    return {
        "run": str(run),
        "out": str(folder),
        "files": sorted(files),
        "landmarks": len(landmarks.identities),
        "scans": drawn.scans,
        "scans_lost": drawn.lost,
        "grid": None if drawn.grid is None else grid_facts(drawn.grid),
        "truncated": reader.truncated or None,
        "seconds": round(time.monotonic() - began_s, 2),
    }


def draw_map(path: Path, out: Path | None, grid: bool) -> dict[str, Any]:
    """The same of a saved map, which has landmarks only. Raises UsageError, NotAMapError, StorageError."""
    need_pictures()
    began_s = time.monotonic()
    saved, _ = read_map(path)
    if grid:
        raise UsageError(
            f"{path} holds landmarks but no scans; draw the grid from the run that it was saved from: "
            f"infant map draw RUN --grid (runs in it: {', '.join(saved.facts.runs)})"
        )
    landmarks = saved.joint.landmarks
    files: dict[str, str | bytes] = {
        "landmarks.csv": landmark_csv(landmarks),
        "landmarks.geojson": landmark_geojson(landmarks, saved.facts.origin),
        "map.png": map_png(None, np.zeros((0, 2)), landmarks, path.name),
    }
    folder = out or path.with_name(f"{path.stem}_drawn")
    write_files(folder, files)
    return {
        "map": str(path),
        "out": str(folder),
        "files": sorted(files),
        "landmarks": len(landmarks.identities),
        "scans_lost": 0,
        "grid": None,
        "truncated": None,
        "seconds": round(time.monotonic() - began_s, 2),
    }


def read_run(reader: RunReader, resolution_m: float | None, progress: Progress) -> DrawnRun:
    """One pass over the run. Raises UsageError where the grid would be larger than the memory that it may take."""
    scans = PlacedScans(reader)
    grid = None if resolution_m is None else OccupancyGrid(resolution_m, MOST_CELLS)
    for number, scan in enumerate(scans):
        if grid is not None:
            try:
                grid.add(scan.sensor_m, scan.points_m, scan.solid)
            except MemoryError as error:
                raise UsageError(
                    f"--resolution {resolution_m:g}: the grid would have {error}, expected at most "
                    f"{MOST_CELLS / 1e6:.0f} million; give a coarser resolution"
                ) from error
        if number % SCANS_A_REPORT == 0:
            progress(reader.read_fraction)
    progress(1.0)
    path_m = np.array(scans.path_m).reshape(-1, 2)
    return DrawnRun(None if grid is None else grid.grid_map(), path_m, scans.landmarks, scans.scans, scans.lost)


def grid_facts(grid: GridMap) -> dict[str, Any]:
    """The grid in figures, for --json."""
    rows, columns = grid.occupancy.shape
    cell_m2 = grid.resolution_m**2
    return {
        "resolution_m": grid.resolution_m,
        "columns": columns,
        "rows": rows,
        "origin_m": list(grid.origin_m),
        "free_m2": round(float((grid.occupancy == FREE).sum()) * cell_m2, 2),
        "occupied_m2": round(float((grid.occupancy == OCCUPIED).sum()) * cell_m2, 2),
    }


def write_files(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """All of them, or none and no new folder. Raises StorageError."""
    made: tuple[Path, ...] = ()
    try:
        refuse_link(folder)  # RUN/map may be one in the run of somebody else
        made = make_folder(folder)
        write_together({folder / name: content for name, content in files.items()})
    except OSError as error:
        take_away(made)
        raise StorageError(f"{folder} cannot be written ({error.strerror}); give another folder with --out") from error


def draw_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    grid = summary["grid"]
    lines = [f"landmarks {summary['landmarks']} confirmed"]
    if grid is not None:
        lines.append(
            f"grid      {grid['columns']} x {grid['rows']} cells of {grid['resolution_m']:g} m, "
            f"{grid['free_m2']:.0f} m2 free, {grid['occupied_m2']:.0f} m2 occupied"
        )
    if summary["scans_lost"]:
        lines.append(
            f"left out  {summary['scans_lost']} of {summary['scans']} scans, from times when the pose was lost"
        )
    if summary["truncated"]:
        lines.append(f"note      {summary['truncated']}")
    return [
        *lines,
        f"files     {summary['out']}: {', '.join(summary['files'])}",
        f"time      {summary['seconds']:.1f} s",
    ]
