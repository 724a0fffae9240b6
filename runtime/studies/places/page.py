"""The study of places as one page of Markdown: what was asked, then every place with its spread."""

from collections.abc import Sequence

from runtime.studies.files import Row
from runtime.studies.paper.spread import spread
from runtime.studies.places.outcomes import DEFAULTS, OWN, Outcome, Outcomes

TRUTH_COLUMNS = {
    "published_rms_m": "RMS, m",
    "published_trimmed_rms_m": "trimmed RMS, m",
    "published_relation_m": "relations, m",
    "published_relation_deg": "relations, deg",
    "over_odometry": "over odometry",
    "lost": "lost",
    "false_lost": "falsely lost",
    "false_tracking": "falsely tracking",
    "landmarks": "landmarks",
    "defects": "failed steps",
}
ODOMETRY = "odometry alone"
CELL_COLUMNS = {
    "published_cells": "occupied cells of 5 cm",
    "odometry_cells": "of odometry",
    "cells_over_odometry": "over odometry",
    "lost": "lost",
    "landmarks": "landmarks",
    "defects": "failed steps",
}
REST_COLUMNS = {
    "landmarks_ever": "landmarks ever",
    "moving_share": "of them on moving beams",
    "landmarks": "landmarks at the end",
    "lost": "lost",
}
BUILDING_COLUMNS = {
    "published_rms_m": "RMS from the start, m",
    "published_aligned_rms_m": "RMS after the fit, m",
    "odometry_rms_m": "odometry from the start, m",
    "odometry_aligned_rms_m": "odometry after the fit, m",
    "lost": "lost",
    "false_lost": "falsely lost",
    "false_tracking": "falsely tracking",
    "landmarks": "landmarks",
    "defects": "failed steps",
}
DROPPED_COLUMNS = {"landmarks": "landmarks", "step_ms": "mean step, ms", "step_max_ms": "longest step, ms"}


def page_lines(outcomes: Outcomes, asked: Sequence[Row], repeats: int) -> list[str]:
    """The whole page."""
    spread_words = (
        "A figure is that of the whole recording; behind it, in brackets, the 95 % bootstrap interval of the mean over",
        f"{repeats} drives that each leave 5 % of the scans out, and the largest of them. Of a simulated place it is",
        "the mean over as many seeds with its interval, and the largest.",
    )
    return [
        "# Every place",
        "",
        f"`infant paper places --repeats {repeats}`, each drive with the method and the files as they are.",
        *(spread_words if repeats else ()),
        "",
        *_table("What was asked", [_asked(row) for row in asked]),
        *_table("Recordings with a truth", _truth_rows(outcomes)),
        *_table("Recordings without a truth: how crisp the map is", _rows(outcomes, CELL_COLUMNS, "published_cells")),
        *_table("People around a sensor at rest", _rows(outcomes, REST_COLUMNS, "moving_share")),
        *_table("The simulated building", _rows(outcomes, BUILDING_COLUMNS, "published_aligned_rms_m")),
        *_table("Beams that give no return", _rows(outcomes, DROPPED_COLUMNS, "step_ms")),
    ]


def _table(title: str, rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    names = [name for name in rows[0] if any(row[name] for row in rows)]
    lines = [f"## {title}", "", f"| {' | '.join(names)} |", f"|{'---|' * len(names)}"]
    return [*lines, *(f"| {' | '.join(str(row[name]) for name in names)} |" for row in rows), ""]


def _asked(row: Row) -> Row:
    bounds = "" if row["low"] is None else f" [{_number(row['low'])}, {_number(row['high'])}]"
    return {
        **{name: row[name] for name in ("place", "way", "figure", "statistic")},
        "value": _number(row["value"]) + bounds,
        "must": "-" if row["must"] is None else _number(row["must"]),
        "aim": _number(row["aim"]),
        "reached": row["reached"],
    }


def _truth_rows(outcomes: Outcomes) -> list[Row]:
    """Odometry first, which is the same whatever the configuration, then the pose with either."""
    rows = []
    for (place, way), outcome in outcomes.items():
        if way not in (OWN, DEFAULTS) or "over_odometry" not in outcome.results[0]:
            continue
        if way == OWN or (place, OWN) not in outcomes:
            alone = {title: _value(outcome, name.replace("published", "odometry")) for name, title in _errors().items()}
            rows.append({"place": place, "with": ODOMETRY, **dict.fromkeys(TRUTH_COLUMNS.values(), ""), **alone})
        rows.append({"place": place, "with": way, **_cells(outcome, TRUTH_COLUMNS)})
    return rows


def _errors() -> dict[str, str]:
    return {name: title for name, title in TRUTH_COLUMNS.items() if name.startswith("published")}


def _rows(outcomes: Outcomes, columns: dict[str, str], needed: str) -> list[Row]:
    return [
        {"place": place, "with": way, **_cells(outcome, columns)}
        for (place, way), outcome in outcomes.items()
        if needed in outcome.results[0]
    ]


def _cells(outcome: Outcome, columns: dict[str, str]) -> dict[str, str]:
    return {title: _value(outcome, name) for name, title in columns.items()}


def _value(outcome: Outcome, name: str) -> str:
    """The whole recording's, or the mean of the seeds; then interval and worst of what was repeated."""
    repeated = outcome.repeated(name)
    if not len(repeated):
        return "" if outcome.whole is None or name not in outcome.whole else _number(outcome.whole[name])
    found = spread(repeated)
    first = found.mean if outcome.whole is None else outcome.whole[name]
    if found.least == found.most == first:
        return _number(first)
    return f"{_number(first)} [{_number(found.mean_low)}, {_number(found.mean_high)}; {_number(found.most)}]"


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
