"""Two runs side by side: figures, findings, paths, and the keys in which their configurations differ."""

import json
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from runtime.atomic_write import beside, write_together
from runtime.errors import StorageError
from runtime.record.folder import RunFolder
from runtime.report.build import examine
from runtime.report.facts import RunFacts
from runtime.report.page import rendered
from runtime.report.plots.drawings import Section, over_time, placed
from runtime.report.plots.plots import Line, Plots, legend

ABSENT = "-"
NAMES = ("first", "second")
FIGURES = (
    ("duration", "s", ("duration_s",)),
    ("RMS error of the pose", "m", ("accuracy", "rms_m")),
    ("RMS error, best 95 %", "m", ("accuracy", "trimmed_rms_m")),
    ("largest error", "m", ("accuracy", "max_m")),
    ("RMS error of odometry alone", "m", ("accuracy", "odometry_rms_m")),
    ("relations, translation", "m", ("accuracy", "relation_translation_m")),
    ("relations, rotation", "deg", ("accuracy", "relation_rotation_deg")),
    ("rate of the loop", "Hz", ("timing", "rate_hz")),
    ("beats missed", "", ("timing", "missed")),
    ("lateness, 99 %", "ms", ("timing", "lateness_ms", "p99")),
    ("step of the filter, median", "ms", ("timing", "stages_ms", "step", "p50")),
    ("step of the filter, 99 %", "ms", ("timing", "stages_ms", "step", "p99")),
    ("scans", "", ("sensors", "laser", "samples")),
    ("age of scans, median", "ms", ("sensors", "laser", "age_ms", "p50")),
    ("wheel samples", "", ("sensors", "wheels", "samples")),
    ("tracking", "share", ("filter", "quality_share", "tracking")),
    ("standard deviation of the position, median", "m", ("filter", "position_sd_m", "p50")),
    ("matches in a scan, median", "", ("filter", "matched", "p50")),
    ("landmarks created", "", ("landmarks", "born")),
    ("landmarks removed", "", ("landmarks", "removed")),
    ("landmarks at the end", "", ("landmarks", "at_end")),
    ("landmarks in the map", "", ("landmarks", "published")),
)
"""Label, unit and place of each figure in report.json."""


def build_comparison(first: Path, second: Path, out: Path | None = None) -> dict[str, Any]:
    """Write the page (and its JSON beside it) and give the JSON. Raises as build_report does."""
    page = out if out is not None else RunFolder.open(second).path / "compare.html"
    data = beside(page, ".json")
    examined = examine(first), examine(second)
    facts = examined[0].facts, examined[1].facts
    result = {
        "runs": [str(first), str(second)],
        "verdicts": [one.figures["verdict"] for one in examined],
        "figures": [
            {"name": name, "unit": unit, "values": [_at(one.figures, place) for one in examined]}
            for name, unit, place in FIGURES
        ],
        "findings": [[finding.title for finding in one.findings] for one in examined],
        "configuration": changed_keys(*facts),
        "files": {"html": str(page), "json": str(data)},
    }
    text = json.dumps(result, indent=1, default=float) + "\n"
    try:
        write_together({page: _page(facts, result), data: text})
    except OSError as error:
        raise StorageError(f"{page} cannot be written ({error.strerror}); give another file with --out") from error
    return result


def comparison_lines(result: dict[str, Any]) -> list[str]:
    """For a person at a terminal."""
    runs = zip(NAMES, result["runs"], result["verdicts"], strict=True)
    lines = [f"{name:9s} {run}: {verdict}" for name, run, verdict in runs]
    lines += [f"{'':44s} {NAMES[0]:>12s} {NAMES[1]:>12s}"]
    for row in result["figures"]:
        if any(value is not None for value in row["values"]):
            shown = (_shown(value) for value in row["values"])
            label = f"{row['name']}, {row['unit']}" if row["unit"] else row["name"]
            lines.append(f"{label:44s} " + " ".join(f"{value:>12s}" for value in shown))
    for name, findings in zip(NAMES, result["findings"], strict=True):
        lines += [f"{name:9s} {title}" for title in findings]
    lines += [f"differs   {row['key']}: {row['values'][0]} | {row['values'][1]}" for row in result["configuration"]]
    return [*lines, f"page      {result['files']['html']}"]


def changed_keys(first: RunFacts, second: RunFacts) -> list[dict[str, Any]]:
    """Keys of the configuration whose values differ, by full name."""
    one, other = (dict(_leaves(facts.configuration.model_dump(mode="json"))) for facts in (first, second))
    keys = [key for key in sorted(one.keys() | other.keys()) if one.get(key, ABSENT) != other.get(key, ABSENT)]
    return [{"key": key, "values": [one.get(key, ABSENT), other.get(key, ABSENT)]} for key in keys]


def _leaves(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _at(report: Any, place: tuple[str, ...]) -> Any:
    for key in place:
        report = report.get(key) if isinstance(report, dict) else None
    return report


def _shown(value: Any) -> str:
    return ABSENT if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _page(facts: tuple[RunFacts, RunFacts], result: dict[str, Any]) -> str:
    names = [str(Path(run).name) for run in result["runs"]]
    names = names if names[0] != names[1] else result["runs"]
    rows = [
        (row["name"], row["unit"], *map(_shown, row["values"]))
        for row in result["figures"]
        if any(value is not None for value in row["values"])
    ]
    plots, section = Plots(max(item.duration_s for item in facts)), Section()
    paths = [
        Line(name, item.ticks.estimated[:, 0], item.ticks.estimated[:, 1], style)
        for name, item, style in zip(names, facts, "ab", strict=True)
    ]
    errors = [
        Line(name, item.ticks.times_s, np.hypot(*(item.ticks.estimated[:, :2] - item.ticks.truth[:, :2]).T), style)
        for name, item, style in zip(names, facts, "ab", strict=True)
    ]
    steps = [
        Line(name, item.ticks.times_s, item.ticks.stages_ms["step"], style)
        for name, item, style in zip(names, facts, "ab", strict=True)
        if "step" in item.ticks.stages_ms
    ]
    section.add("Published poses, from above", plots.over_ground(paths, facts[0].ticks.times_s), legend(paths))
    if any(np.isfinite(line.y).any() for line in errors):
        over_time(plots, section, "Distance from the truth", errors, "error, m")
    over_time(plots, section, "Step of the filter", steps, "duration, ms")
    script, drawings = placed({"all": section})
    return rendered(
        "compare.html",
        names=names,
        verdicts=result["verdicts"],
        rows=rows,
        script=script,
        drawings=drawings["all"],
        findings=list(zip_longest(*result["findings"], fillvalue="")),
        configuration=[(row["key"], *row["values"]) for row in result["configuration"]],
    )
