"""What `infant map draw` writes can be read by those that it is written for."""

import csv
import gc
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime.errors import StorageError, UsageError
from runtime.maps.draw import draw_run, write_files
from runtime.maps.grid_files import map_server_yaml, pgm
from runtime.maps.picture import map_png
from runtime.maps.placed_scans import at_scan
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from slam.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, GridMap
from slam.pose import Pose2
from tests.support.runtime.drawn_drive import MOUNT, YARD_M, drive, poles
from tests.support.runtime.recorded_values import make_estimate

TICKS = 90


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    writer = RunWriter(folder / "run.mcap", RunHeader(f"[slam.mount]\nx_m = {MOUNT.x_m}\n", "live").metadata)
    for records in drive(TICKS):
        writer.add(records)
    writer.close()
    return folder


def no_progress(_fraction: float) -> None:
    pass


def as_map_server_reads(folder: Path) -> tuple[NDArray[np.int8], tuple[float, float], float]:
    """Trinary mode of nav2's map_server, from its documentation."""
    facts = dict(line.split(": ", 1) for line in (folder / "map.yaml").read_text().splitlines())
    assert (facts["mode"], facts["negate"]) == ("trinary", "0")
    data = (folder / facts["image"]).read_bytes()
    magic, size, depth, pixels = data.split(b"\n", 3)
    assert (magic, depth) == (b"P5", b"255")
    columns, rows = map(int, size.split())
    shares = (255 - np.frombuffer(pixels, np.uint8).reshape(rows, columns)[::-1].astype(float)) / 255
    occupancy = np.full((rows, columns), UNKNOWN, np.int8)
    occupancy[shares > float(facts["occupied_thresh"])] = OCCUPIED
    occupancy[shares < float(facts["free_thresh"])] = FREE
    x, y, yaw = json.loads(facts["origin"])
    assert yaw == 0
    return occupancy, (x, y), float(facts["resolution"])


def test_map_server_reads_the_grid_as_it_was(tmp_path: Path) -> None:
    cells = np.random.default_rng(0).choice(np.array((UNKNOWN, FREE, OCCUPIED), np.int8), (7, 5))
    grid = GridMap(cells, (-3.25, 1.5), 0.05)
    (tmp_path / "map.pgm").write_bytes(pgm(grid))
    (tmp_path / "map.yaml").write_text(map_server_yaml(grid, "map.pgm"))
    occupancy, origin_m, resolution_m = as_map_server_reads(tmp_path)
    assert np.array_equal(occupancy, cells)
    assert (*origin_m, resolution_m) == (-3.25, 1.5, 0.05)


def test_the_map_of_a_drive_has_its_walls_and_poles_where_they_are_and_no_walker(run: Path, tmp_path: Path) -> None:
    summary = draw_run(run, tmp_path, 0.1, no_progress)
    assert summary["files"] == ["landmarks.csv", "landmarks.geojson", "map.pgm", "map.png", "map.yaml"]
    occupancy, origin_m, resolution_m = as_map_server_reads(tmp_path)
    rows, columns = np.nonzero(occupancy == OCCUPIED)
    occupied = np.column_stack((columns, rows)) * resolution_m + origin_m + 0.5 * resolution_m
    known = poles(np.random.default_rng(1))
    to_wall = YARD_M - np.abs(occupied).max(axis=1)
    to_pole = np.linalg.norm(occupied[:, None] - known, axis=2).min(axis=1)
    off = np.minimum(np.abs(to_wall), to_pole)
    assert np.mean(off < 0.4) > 0.99, "nothing stands in the open, the walker did not stay"
    assert (np.abs(to_wall) < 0.3).sum() > 200
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_landmarks_are_the_same_in_the_table_and_in_geojson(run: Path, tmp_path: Path) -> None:
    summary = draw_run(run, tmp_path, None, no_progress)
    assert "map.pgm" not in summary["files"]
    rows = list(csv.DictReader(io.StringIO((tmp_path / "landmarks.csv").read_text())))
    features = json.loads((tmp_path / "landmarks.geojson").read_text())["features"]
    assert len(rows) == len(features) == summary["landmarks"] > 5
    for row, feature in zip(rows, features, strict=True):
        assert feature["geometry"]["coordinates"] == [float(row["x_m"]), float(row["y_m"])]
        assert feature["id"] == int(row["identity"])
        assert float(row["existence"]) > 0.95


def test_a_scan_lies_where_the_rover_was_when_it_was_measured() -> None:
    before = make_estimate(1000, np.random.default_rng(0))
    step = Pose2(0.4, 0.0, 0.2)
    after = replace(make_estimate(1100, np.random.default_rng(1)), odom_from_body=before.odom_from_body @ step)
    half = at_scan(before.stamp_ns + 50, before, after)
    assert (after.map_from_body.inverse() @ half).as_array() == pytest.approx(
        (step.inverse() @ Pose2(0.2, 0.0, 0.1)).as_array()
    )
    assert at_scan(before.stamp_ns, before, after) is after.map_from_body


def test_too_fine_a_grid_and_a_folder_that_is_none_are_refused_in_a_sentence(run: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--resolution 0\.001: the grid would have .* give a coarser"):
        draw_run(run, tmp_path / "fine", 0.001, no_progress)
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="give another folder with --out"):
        draw_run(run, tmp_path / "file", None, no_progress)


def test_nothing_is_drawn_where_a_link_in_a_run_of_others_points(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "map").symlink_to(tmp_path / "home")
    with pytest.raises(StorageError, match=r"map cannot be written .it is a link"):
        write_files(tmp_path / "map", {"landmarks.csv": "x"})
    assert not any((tmp_path / "home").iterdir())


def test_nothing_of_a_picture_stays_in_memory() -> None:
    """Eleven megabytes of dots did with each map: a hundred hostile runs took 343 MB."""
    backend = pytest.importorskip("matplotlib.backends.backend_agg", reason="matplotlib is not installed")
    gc.disable()
    try:
        map_png(None, np.zeros((2, 2)), None, "yard")
        assert not any(isinstance(each, backend.RendererAgg) for each in gc.get_objects())
    finally:
        gc.enable()
