"""report.html: one self-contained page of a run; nothing in it asks the network for anything.

The words and their order stand in templates/report.html; here are the numbers and drawings that it shows.
"""

import re
from collections.abc import Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from runtime.printable import printable
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, span_text, spans_text
from runtime.report.plots.drawings import drawings

KEY = re.compile(
    r"(\[[a-z_]+(\.[a-z_]+)*\]|[a-z_]+(\.[a-z_0-9]+)+|\b[a-z]+(_[a-z0-9]+)+)"  # a table, a full name, or its last part
    r"( = [-+\d.]*\d| = (true|false))?"  # and the value it is to have
)
ACCURACY = (
    ("rms_m", "RMS error", "m"),
    ("trimmed_rms_m", "RMS error, best 95 %", "m"),
    ("max_m", "largest error", "m"),
    ("odometry_rms_m", "RMS error of odometry alone", "m"),
    ("relation_translation_m", "relations, translation", "m"),
    ("relation_rotation_deg", "relations, rotation", "deg"),
)


def page(facts: RunFacts, findings: Sequence[Finding], figures: dict[str, Any]) -> str:
    """The whole page."""
    accuracy, quality = figures["accuracy"], figures["filter"]["quality_share"]
    events = figures["events"]["first"]
    recognised_s = [found["time_s"] for found in figures["recognitions"] if not found["is_new"]]
    script, placed = drawings(facts, findings, recognised_s)
    return rendered(
        "report.html",
        facts=facts,
        findings=findings,
        figures=figures,
        origin=_origin(facts),
        tiles=tiles(figures),
        script=script,
        drawings=placed,
        configuration=Markup("\n").join(map(printable, facts.configuration.text.split("\n"))),
        accuracy=[
            (label, f"{accuracy[key]:.3f} {unit}") for key, label, unit in ACCURACY if accuracy.get(key) is not None
        ],
        recognitions=[_recognition_row(each) for each in figures["recognitions"]],
        sensors=[_sensor_row(name, sensor) for name, sensor in figures["sensors"].items()],
        quality=", ".join(f"{word} {share:.1%}" for word, share in quality.items() if share),
        geometry=[_geometry_row(row) for row in figures["geometry"]],
        stages=[(name, *spread_cells(figures["timing"]["stages_ms"][name])) for name in by_length(figures)],
        health=[_health_row(each) for each in figures["health"]],
        events=[_event_row(event) for event in events],
    )


def rendered(template: str, **values: Any) -> str:
    """A page from a file in templates/; values are escaped, control characters too, unless they are Markup."""
    environment = Environment(
        loader=PackageLoader("runtime.report"),
        autoescape=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["keys_marked"] = keys_marked
    environment.filters["span"] = span_text
    return environment.get_template(template).render(values)


def keys_marked(sentence: str) -> Markup:
    """A remedy with its configuration keys, and the values that they are to have, as code."""
    return Markup(KEY.sub(lambda found: f"<code>{found.group(0)}</code>", str(escape(sentence))))


def tiles(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """The figures that a reviewer looks at first; those that are not known are left out."""
    timing, accuracy, laser = figures["timing"], figures["accuracy"], figures["sensors"]["laser"]
    late = timing["lateness_ms"]
    late = late if late and late["max"] > 0.0 else None  # a recording of others has no beats to be late for
    shown = [
        (f"{figures['duration_s']:.1f} s", "duration"),
        (f"{accuracy['rms_m']:.3f} m" if accuracy["rms_m"] is not None else "", "RMS error of the pose"),
        (
            f"{accuracy['odometry_rms_m']:.3f} m" if accuracy["odometry_rms_m"] is not None else "",
            "RMS error of odometry alone",
        ),
        (f"{timing['rate_hz']:.2f} Hz" if timing["rate_hz"] else "", "rate of the loop"),
        (f"{timing['missed']} of {timing['ticks'] + timing['missed']}" if late else "", "beats missed"),
        (f"{late['p99']:.2f} ms" if late else "", "lateness, 99 %"),
        (f"{laser['samples']}", "scans"),
        (f"{figures['landmarks']['at_end']}", "landmarks"),
    ]
    return [item for item in shown if item[0]]


def _origin(facts: RunFacts) -> str:
    version = facts.versions.get("infant", "")
    rover = f"rover {facts.configuration.rover}"
    parts = (facts.created_utc, facts.source, f"infant {version}" if version else "", rover)
    return ", ".join(part for part in parts if part)


def by_length(figures: dict[str, Any]) -> list[str]:
    """Stages of a tick, the longest first; those that were measured."""
    stages = {name: known for name, known in figures["timing"]["stages_ms"].items() if known}
    return sorted(stages, key=lambda name: -float(stages[name]["p50"]))


def spread_cells(known: dict[str, float]) -> tuple[str, ...]:
    """Median, 99 % and largest."""
    return tuple(f"{known[name]:.3f}" for name in ("p50", "p99", "max"))


def _health_row(each: dict[str, Any]) -> tuple[str, ...]:
    spans = spans_text([(start, end) for start, end in each["spans_s"]])
    reasons = "; ".join(f"{reason} ({seconds:.1f} s)" for reason, seconds in each["reasons_s"].items())
    return each["state"], f"{each['seconds']:.1f} s", f"{each['share']:.0%}", spans, reasons


def _event_row(event: dict[str, Any]) -> tuple[str, ...]:
    when, reason = f"{event['time_s']:.2f}", event["reason"]
    if event["times"] > 1:
        when = f"{event['time_s']:.1f}-{event['until_s']:.1f}"
        reason = f"{event['times']} times, first: {reason}"
    return when, event["severity"], f"{event['source']}.{event['kind']}", reason


def _recognition_row(found: dict[str, Any]) -> tuple[object, ...]:
    where = f"new map {found['map_id']}" if found["is_new"] else f"map {found['map_id']}"
    if found["joined"]:
        where += f", joined by map {found['joined']}"
    if found["is_new"]:
        return (f"{found['time_s']:.1f}", where, "", "", "", "")
    mirror = "" if found["mirror_odds"] is None else f"{found['mirror_odds']:.0f}"
    moved = f"{found['moved_m']:.2f} m, {found['turned_deg']:.0f} deg"
    matches = f"walls, {found['matches']}" if found["by_scans"] else found["matches"]
    return (f"{found['time_s']:.1f}", where, matches, f"{found['odds']:.0f}", mirror, moved)


def _sensor_row(name: str, sensor: dict[str, Any]) -> tuple[object, ...]:
    rate = f"{sensor['usual_rate_hz']} Hz" if sensor["usual_rate_hz"] else ""
    silent = ", ".join(span_text((start, end)) for start, end in sensor["gaps_s"][:6]) or "never"
    return name, sensor["samples"], rate, silent


def _geometry_row(row: dict[str, Any]) -> tuple[str, ...]:
    interval = row["interval"]
    return (
        f"{row['label']}, {row['unit']}",
        f"{row['configured']:.1f}",
        "cannot tell" if interval is None else f"{interval[0]:.1f} to {interval[1]:.1f}",
        f"{row['detectable']:.1f}",
    )
