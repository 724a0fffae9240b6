"""A map as a picture for people: grid, path and landmarks, with metres at the edges."""

import gc
import io
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.optional_packages import needs
from slam.estimate import LandmarkMap
from slam.maps.occupancy_grid import UNKNOWN, GridMap, OccupancyArray

WIDTH_IN, DPI = 10.0, 160
MOST_DOTS = 1600
LEAST_SHARE, MOST_SHARE = 0.3, 1.5  # of the width: how high a picture may be


def need_pictures() -> None:
    """Raises UsageError where pictures cannot be drawn; called before the work and not after it."""
    with needs("matplotlib", "a picture of a map"):
        import matplotlib  # noqa: F401 only whether it is there


def map_png(grid: GridMap | None, path_m: FloatArray, landmarks: LandmarkMap | None, title: str) -> bytes:
    """PNG of what there is; path_m (n, 2)."""
    png = _drawn(grid, path_m, landmarks, title)
    gc.collect()  # a figure refers to itself: its 11 MB of dots would stay for long, once more with each map
    return png


def _drawn(grid: GridMap | None, path_m: FloatArray, landmarks: LandmarkMap | None, title: str) -> bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import, and nothing else here needs it
    from matplotlib.figure import Figure

    low, high = _bounds(grid, path_m, landmarks)
    span = np.maximum(high - low, 1.0)
    height = WIDTH_IN * float(np.clip(span[1] / span[0], LEAST_SHARE, MOST_SHARE))
    figure = Figure(figsize=(WIDTH_IN, height), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    if grid is not None and grid.occupancy.size:
        coarse, factor = _coarse(grid.occupancy)
        right, top = low + grid.resolution_m * factor * np.array(coarse.shape[::-1])
        shown = np.where(coarse == UNKNOWN, np.float32(0.72), np.float32(1.0) - np.float32(0.01) * coarse)
        extent = (low[0], right, low[1], top)
        axes.imshow(shown, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent, interpolation="antialiased")
    if len(path_m):
        axes.plot(path_m[:, 0], path_m[:, 1], color="tab:blue", linewidth=0.8, label="path")
        axes.plot(*path_m[0], "o", color="tab:blue", markersize=5, label="start")
    if landmarks is not None and len(landmarks.means_m):
        axes.plot(*landmarks.means_m.T, ".", color="tab:red", markersize=3, label=f"{len(landmarks.means_m)} landmarks")
    margin = 0.02 * span
    axes.set(xlabel="x, m", ylabel="y, m", title=title, aspect="equal")
    axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
    axes.set_ylim(low[1] - margin[1], high[1] + margin[1])
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", framealpha=0.8)
    buffer = io.BytesIO()
    canvas: Any = FigureCanvasAgg(figure)
    canvas.print_png(buffer)
    return buffer.getvalue()


def _coarse(occupancy: OccupancyArray) -> tuple[OccupancyArray, int]:
    """No more cells than the picture has dots, and how many became one along each side.

    The most occupied cell of each block counts, so that a thin wall stays.
    """
    factor = -(-max(occupancy.shape) // MOST_DOTS)
    rows, columns = (-(-size // factor) for size in occupancy.shape)
    padded = np.full((rows * factor, columns * factor), UNKNOWN, dtype=np.int8)
    padded[: occupancy.shape[0], : occupancy.shape[1]] = occupancy
    return padded.reshape(rows, factor, columns, factor).max(axis=(1, 3)), factor


def _bounds(grid: GridMap | None, path_m: FloatArray, landmarks: LandmarkMap | None) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner, m."""
    if grid is not None and grid.occupancy.size:
        low = np.array(grid.origin_m)
        return low, low + grid.resolution_m * np.array(grid.occupancy.shape[::-1])
    points = np.vstack((path_m, np.zeros((0, 2)) if landmarks is None else landmarks.means_m))
    return (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
