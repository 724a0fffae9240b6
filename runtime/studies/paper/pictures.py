"""The pictures, as PNG and SVG."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import UsageError
from runtime.studies.files import Row
from runtime.studies.paper.drives.recorded_drive import VICTORIA
from runtime.studies.paper.study import OUTDOOR, PRINTED, VICTORIA_PARTICLES, Cell, Outcomes

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ModuleNotFoundError as error:
    raise UsageError("the pictures need optional packages: pip install 'infant[review]'") from error

COLOURS = {"truth": "black", "particles": "tab:blue", "published": "tab:red", "odometry": "tab:gray"}
NAMES = {"normal": "normal estimation", "proposed": "proposed, unscented", "ekf": "proposed, EKF (FastSLAM 2.0)"}
FRONT_ENDS = {OUTDOOR: "front end of this project (default)", PRINTED: "front end as the paper prints it"}
ABLATED = {"particles_largest_m": "largest error of the particles, m", "landmarks": "landmarks at the end"}


def fig1(outcomes: Outcomes, folder: Path) -> list[Path]:
    """Paths and maps of the first seed, worlds P and V2, normal and proposed."""
    cells = [Cell(world, arm) for world in ("P", "V2") for arm in ("normal", "proposed")]
    figure, axes = _grid(2, 2, (11, 11))
    for axis, cell in zip(axes, cells, strict=True):
        _paths(axis, cell, outcomes[cell][0])
    figure.suptitle("Seed 0, frame of the start pose; simulated worlds of point landmarks")
    return _save(figure, folder / "fig1")


def fig2(outcomes: Outcomes, folder: Path) -> tuple[list[Path], list[Row]]:
    """Position error over time, frame of the start pose, of the first seed; its data as rows."""
    figure, axes = _grid(1, 2, (12, 4.5))
    rows: list[Row] = []
    for axis, world in zip(axes, ("P", "V2"), strict=True):
        for arm, name, colour in (
            ("normal", "particles", "tab:orange"),
            ("proposed", "particles", "tab:blue"),
            ("proposed", "published", "tab:red"),
        ):
            result = outcomes[Cell(world, arm)][0]
            errors = np.hypot(*(np.array(result["paths"][name]) - np.array(result["paths"]["truth"])).T)
            axis.plot(result["seconds"], errors, color=colour, label=f"{NAMES[arm]}, {name}", linewidth=1)
            rows += [
                {"world": world, "arm": arm, "path": name, "seconds": second, "error_m": round(float(error), 3)}
                for second, error in zip(result["seconds"], errors, strict=True)
            ]
        axis.set(title=f"World {world}, seed 0", xlabel="time, s", ylabel="position error in the start frame, m")
        axis.legend(fontsize=8)
    return _save(figure, folder / "fig2"), rows


def table1(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Landmarks, time and likelihoods with their intervals."""
    figure, axes = _grid(1, 3, (12, 4))
    names = (
        ("landmarks", "landmarks at the end"),
        ("filter_cpu_s", "CPU of the filter, s a drive"),
        ("likelihoods", "likelihoods computed"),
    )
    for axis, (name, title) in zip(axes, names, strict=True):
        shown = [row for row in rows if row["quantity"] == name]
        low = [row["mean"] - row["mean_low"] for row in shown]
        high = [row["mean_high"] - row["mean"] for row in shown]
        labels = [f"{row['world']}, {row['arm']}\n{row['seeds']} seeds" for row in shown]
        axis.bar(labels, [row["mean"] for row in shown], yerr=(low, high), color="tab:blue", capsize=4)
        axis.set_title(f"{title} (mean, 95 %)", fontsize=10)
        axis.tick_params("x", labelsize=7)
        if name != "landmarks":
            axis.set_yscale("log")
            continue
        for printed, arm in ((627, "normal"), (213, "proposed")):
            axis.axhline(printed, color="tab:gray", linestyle=":")
            axis.annotate(f"paper, {arm}: {printed}", (-0.45, printed), (0, 3), textcoords="offset points", fontsize=7)
    return _save(figure, folder / "table1")


def ablation(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Each arm against the proposed one, as paired differences; particles as in the study."""
    figure, axes = _grid(1, 2, (12, 5))
    for axis, (name, title) in zip(axes, ABLATED.items(), strict=True):
        compared = [row for row in rows if row["quantity"] == name and row["against"] == "proposed"]
        shown = [row for row in compared if row["particles"] == ""][::-1]
        middle = np.array([row["difference"] for row in shown])
        low = middle - [row["difference_low"] for row in shown]
        high = np.array([row["difference_high"] for row in shown]) - middle
        axis.errorbar(middle, range(len(shown)), xerr=(low, high), fmt="o", capsize=3)
        axis.set_yticks(range(len(shown)), [f"{row['arm']} ({row['seeds']})" for row in shown], fontsize=8)
        axis.axvline(0.0, color="black", linewidth=0.8)
        axis.set(xlabel=f"{title}, minus proposed")
    figure.suptitle("World V2: paired differences from the proposed filter, mean and 95 % (seeds in brackets)")
    return _save(figure, folder / "ablation")


def fig5(outcomes: Outcomes, folder: Path) -> list[Path]:
    """One scan of the simulated drive: what was seen, what was removed, what became a feature."""
    figure, axes = _grid(1, 2, (14, 7), shared=True)
    for axis, world in zip(axes, (OUTDOOR, PRINTED), strict=True):
        scan = outcomes[Cell(world, "proposed")][0]["scan"]
        points, features = np.array(scan["points_m"]), np.array(scan["features_m"]).reshape(-1, 2)
        licensed = np.array(scan["features_may_create"], dtype=bool)
        moving = np.array(scan["moving"], dtype=bool)
        for chosen, style in (
            (points[~moving], {"s": 3, "color": "tab:gray", "label": "laser points"}),
            (points[moving], {"s": 6, "color": "tab:red", "label": "on people and robots (truth)"}),
            (features[licensed], {"s": 40, "facecolors": "none", "edgecolors": "tab:blue", "label": "feature points"}),
            (features[~licensed], {"s": 30, "marker": "x", "color": "tab:orange", "label": "may not become landmarks"}),
        ):
            axis.scatter(chosen[:, 0], chosen[:, 1], **style)  # type: ignore[arg-type]
        axis.plot(*scan["robot_m"][:2], "k^", markersize=9, label="robot")
        axis.set(title=FRONT_ENDS[world], xlabel="x, m", ylabel="y, m", aspect="equal")
        axis.legend(fontsize=7)
    figure.suptitle("One scan of a simulated outdoor drive, seed 0 (the original recording is not public)")
    return _save(figure, folder / "fig5")


def fig6(outcomes: Outcomes, folder: Path) -> list[Path]:
    """Paths with the EKF and with the unscented proposal, simulated and, where it is there, on Victoria Park."""
    worlds = ((OUTDOOR, None), (VICTORIA, VICTORIA_PARTICLES[0]))
    cells = [Cell(world, arm, particles) for world, particles in worlds for arm in ("ekf", "proposed")]
    cells = [cell for cell in cells if cell in outcomes]
    figure, axes = _grid(len(cells) // 2, 2, (12, 5.5 * len(cells) // 2))
    for axis, cell in zip(axes, cells, strict=True):
        _paths(axis, cell, outcomes[cell][0], "." if cell.world == VICTORIA else "-")
    figure.suptitle(
        "Seed 0. Outdoor drive: simulated. Victoria Park: recorded; every tenth GPS fix (truth) and the poses then, "
        "after the rigid fit",
        fontsize=10,
    )
    return _save(figure, folder / "fig6")


def _paths(axis: Axes, cell: Cell, result: dict[str, Any], style: str = "-") -> None:
    """Maps and paths; style "." where positions are too far apart in time to be joined by a line."""
    for of, mark in (("true_landmarks_m", "k+"), ("map_m", "g.")):
        points = np.array(result.get(of, [])).reshape(-1, 2)
        if len(points):
            axis.plot(*points.T, mark, markersize=5, label=of.removesuffix("_m").replace("_", " "))
    for name in sorted(result["paths"], key=list(COLOURS).index):  # truth first: the others lie on it
        width = 2.5 if name == "truth" else 1.0
        line = {"linestyle": "none", "marker": ".", "markersize": 2 * width} if style == "." else {"linewidth": width}
        axis.plot(*np.array(result["paths"][name]).T, color=COLOURS[name], label=name, **line)
    axis.set(title=f"{cell.world}: {NAMES.get(cell.arm, cell.arm)}", xlabel="x, m", ylabel="y, m", aspect="equal")
    axis.legend(fontsize=7)


def _grid(rows: int, columns: int, inches: tuple[float, float], shared: bool = False) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=inches, layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(rows, columns, sharex=shared, sharey=shared)).ravel())


def _save(figure: Figure, stem: Path) -> list[Path]:
    paths = [stem.with_suffix(suffix) for suffix in (".png", ".svg")]
    for path in paths:
        figure.savefig(path, dpi=110)
    return paths
