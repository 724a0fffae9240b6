"""The tables of the paper's study as rows: paths, maps, one scan, and Table I."""

from collections.abc import Sequence

from runtime.studies.files import Row
from runtime.studies.paper.study import Cell, Outcomes


def path_rows(outcomes: Outcomes) -> list[Row]:
    """Positions of the first seed: one row for each path and step."""
    return [
        {"world": cell.world, "arm": cell.arm, "path": name, "step": step, "x_m": x, "y_m": y}
        for cell, results in outcomes.items()
        for name, points in results[0].get("paths", {}).items()
        for step, (x, y) in enumerate(points)
    ]


def map_rows(outcomes: Outcomes) -> list[Row]:
    """Landmarks of the first seed, true ones and estimated ones."""
    return [
        {"world": cell.world, "arm": cell.arm, "of": of, "x_m": x, "y_m": y}
        for cell, results in outcomes.items()
        for of in ("true_landmarks_m", "map_m", "published_map_m")
        for x, y in results[0].get(of, ())
    ]


def scan_rows(outcomes: Outcomes, cell: Cell) -> list[Row]:
    """What Fig. 5 shows of one scan."""
    scan = outcomes[cell][0]["scan"]
    beams = zip(scan["points_m"], scan["moving"], scan["removed"], strict=True)
    rows: list[Row] = [
        {"world": cell.world, "kind": "beam", "x_m": x, "y_m": y, "moving": moving, "removed": removed}
        for (x, y), moving, removed in beams
    ]
    features = zip(scan["features_m"], scan["features_moving"], scan["features_may_create"], strict=True)
    rows += [
        {"world": cell.world, "kind": "feature", "x_m": x, "y_m": y, "moving": moving, "may_create": licensed}
        for (x, y), moving, licensed in features
    ]
    return rows


def table1_rows(spreads: Sequence[Row]) -> list[Row]:
    """Table I beside the paper's numbers, with the particles of the study; its unit of time is not given there."""
    printed = {("normal", "landmarks"): 627, ("proposed", "landmarks"): 213}
    printed |= {("normal", "filter_cpu_s"): 643, ("proposed", "filter_cpu_s"): 109}
    wanted = ("landmarks", "landmarks_in_view", "filter_cpu_s", "joint_cpu_s", "likelihoods")
    return [
        {"paper": printed.get((row["arm"], row["quantity"]), ""), **row}
        for row in spreads
        if row["world"] in ("P", "V2")
        and row["arm"] in ("normal", "proposed")
        and row["quantity"] in wanted
        and row["particles"] == ""
    ]
