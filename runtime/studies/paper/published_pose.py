"""The published pose in figures, beside what this project asks of itself: one row for each figure.

Simulated errors are given twice, in the frame of the start pose and after the best rigid fit; recorded ones as their
truth allows. The published pose has no random part: on a recording it is the same for every seed, so that its spread
there is shown by leaving out 5 % of what was seen.
"""

from collections.abc import Iterable, Sequence

from runtime.studies.files import Row
from runtime.studies.paper.drives.arms import PROPOSED
from runtime.studies.paper.study import BLIND
from runtime.studies.paper.targets import RATIO, WORST, Target, targets

UNSCENTED_QUANTITIES = ("particles_largest_m", "particles_aligned_rms_m", "particles_aligned_trimmed_rms_m")


def published_rows(spreads: Sequence[Row], comparisons: Sequence[Row]) -> list[Row]:
    """Each figure with its 95 % interval and whether it is what was asked for; those without a run are left out."""
    rows = []
    for figure in targets():
        source = comparisons if figure.against else spreads
        found = _row_of(figure, source)
        if found is None:
            continue
        value, low, high = _values(figure.statistic, found)
        rows.append(
            {
                "what": figure.what,
                "frame": figure.frame,
                "world": figure.world,
                "particles": figure.particles or "as given",
                "left_out": figure.left_out,
                "statistic": figure.statistic,
                "value": value,
                "low": low,
                "high": high,
                "seeds": found["seeds"],
                "must": None if figure.limits is None else figure.limits[0],
                "aim": None if figure.limits is None else figure.limits[1],
                "reached": _reached(figure, value),
            }
        )
    return rows


def unscented_rows(comparisons: Iterable[Row]) -> list[Row]:
    """EKF minus unscented, paired by seed: below zero over the whole interval, the unscented proposal is worse."""
    rows = []
    for row in comparisons:
        name = str(row["quantity"])
        told = name.startswith("particles_error") if row["world"] == BLIND else name in UNSCENTED_QUANTITIES
        if row["arm"] != "ekf" or row["against"] != PROPOSED or not told:
            continue
        low, high = row["difference_low"], row["difference_high"]
        verdict = "unscented is better" if low > 0 else "unscented is worse" if high < 0 else "no difference"
        names = ("world", "quantity", "seeds", "difference", "difference_low", "difference_high")
        rows.append({**{name: row[name] for name in names}, "verdict": verdict})
    return rows


def published_lines(rows: Iterable[Row], unscented: Iterable[Row]) -> list[str]:
    """For people."""
    lines = ["The published pose (mean or median with its 95 % interval; what is asked for: must, aim)"]
    for row in rows:
        left = f", {100 * row['left_out']:.0f} % left out" if row["left_out"] else ""
        asked = "" if row["must"] is None else f"  must {row['must']:g}, aim {row['aim']:g}: {row['reached']}"
        interval = "" if row["low"] is None else f" [{row['low']:.3g}, {row['high']:.3g}]"
        where = f"{row['world']}{left}, {row['particles']} particles"
        lines.append(
            f"  {row['what']} ({row['frame']}), {where}, {row['seeds']} seeds: {row['statistic']} "
            f"{row['value']:.3g}{interval}{asked}"
        )
    lines.append("Unscented against EKF, paired: error of the EKF minus error of the unscented proposal")
    for row in unscented:
        lines.append(
            f"  {row['world']}, {row['quantity']}: {row['difference']:+.4f} [{row['difference_low']:+.4f}, "
            f"{row['difference_high']:+.4f}] over {row['seeds']} seeds: {row['verdict']}"
        )
    return lines


def _row_of(figure: Target, rows: Sequence[Row]) -> Row | None:
    for row in rows:
        same = row["world"] == figure.world and row["arm"] == PROPOSED and row["quantity"] == figure.quantity
        same &= row["left_out"] == figure.left_out and row["particles"] == figure.particles
        if same and row.get("against", "") == figure.against:
            return row
    return None


def _values(statistic: str, row: Row) -> tuple[float, float | None, float | None]:
    if statistic == RATIO:
        return row["ratio"], row["ratio_low"], row["ratio_high"]
    if statistic == WORST:
        return row["most"], None, None
    return row[statistic], row[f"{statistic}_low"], row[f"{statistic}_high"]


def _reached(figure: Target, value: float) -> str:
    if figure.limits is None:
        return ""
    must, aim = figure.limits
    least_must, least_aim = (1.0, 2.0) if figure.quantity == "nees_median" else (-1.0, -1.0)
    return "aim" if least_aim <= value <= aim else "must" if least_must <= value <= must else "not reached"
