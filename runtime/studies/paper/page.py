"""A study as one page of Markdown: every claim, every figure with its interval, in tables."""

from collections.abc import Iterable, Sequence
from typing import Any

from runtime.studies.files import Row


def report_lines(result: dict[str, Any]) -> list[str]:
    """The result of runtime.paper.publish_study.reproduce as Markdown."""
    seeds = f"{result['seeds']} seeds, {result['particles']} particles where nothing else is said"
    lines = [f"`infant paper {' '.join(result['parts'])}`: {seeds}.", ""]
    lines += _section("What the paper says, and what was found", _claim_rows(result["claims"]))
    lines += _section("The published pose", _published_rows(result["published"]))
    lines += _section(
        "Unscented against EKF proposal: error of the EKF minus that of the unscented one", _unscented(result)
    )
    lines += _section("Ablation in V2: difference from the proposed filter", _ablation(result["comparisons"]))
    lines += ["## Ours, because the paper does not give them", ""]
    lines += [f"- {parameter}" for parameter in result["not_given_in_the_paper"]]
    return lines


def _section(title: str, rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    names = list(rows[0])
    lines = [f"## {title}", "", f"| {' | '.join(names)} |", f"|{'---|' * len(names)}"]
    return [*lines, *(f"| {' | '.join(str(row[name]) for name in names)} |" for row in rows), ""]


def _claim_rows(claims: Iterable[Row]) -> list[Row]:
    return [
        {"world": row["where"], "the paper": row["paper"], "here": row["here"], "": row["verdict"]} for row in claims
    ]


def _published_rows(rows: Iterable[Row]) -> list[Row]:
    return [
        {
            "figure": row["what"],
            "frame": row["frame"],
            "world": row["world"] + (f", {100 * row['left_out']:.0f} % left out" if row["left_out"] else ""),
            "particles": row["particles"],
            "seeds": row["seeds"],
            "": row["statistic"],
            "value": _number(row["value"]) + _interval(row),
            "must": "" if row["must"] is None else _number(row["must"]),
            "aim": "" if row["aim"] is None else _number(row["aim"]),
            "reached": row["reached"],
        }
        for row in rows
    ]


def _unscented(result: dict[str, Any]) -> list[Row]:
    return [
        {
            "world": row["world"],
            "quantity": row["quantity"],
            "seeds": row["seeds"],
            "difference, m": f"{row['difference']:+.4f} [{row['difference_low']:+.4f}, {row['difference_high']:+.4f}]",
            "": row["verdict"],
        }
        for row in result["unscented"]
    ]


def _ablation(comparisons: Iterable[Row]) -> list[Row]:
    rows: dict[str, Row] = {}
    names = {
        "particles_largest_m": "particles, largest error, m",
        "published_largest_m": "published pose, largest error, m",
        "landmarks": "landmarks",
    }
    for row in comparisons:
        switched = row["arm"].startswith(("without ", "only "))
        if switched and row["world"] == "V2" and row["against"] == "proposed" and not row["particles"]:
            empty = {"arm": row["arm"], "seeds": row["seeds"], **dict.fromkeys(names.values(), "")}
            found = rows.setdefault(row["arm"], empty)
            if row["quantity"] in names:
                value = f"{row['difference']:+.2f} [{row['difference_low']:+.2f}, {row['difference_high']:+.2f}]"
                found[names[row["quantity"]]] = value
    return list(rows.values())


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _interval(row: Row) -> str:
    """Of many seeds; nothing of one, or where there is none."""
    if row["low"] is None or row["seeds"] == 1:
        return ""
    if row["low"] == row["high"]:
        return " (the same in every seed)"
    return f" [{_number(row['low'])}, {_number(row['high'])}]"
