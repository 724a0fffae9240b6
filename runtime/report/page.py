"""report.html: one self-contained page of a run; nothing in it asks the network for anything.

The words and their order stand in templates/report.html; here are the numbers and drawings that it shows.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from runtime.printable import printable
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, Interval, span_text
from runtime.report.plots import Line, map_plot, time_plot, timeline

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
Drawings = dict[str, Markup]


def page(facts: RunFacts, findings: Sequence[Finding], figures: dict[str, Any]) -> str:
    """The whole page."""
    accuracy, quality = figures["accuracy"], figures["filter"]["quality_share"]
    events = figures["events"]["first"]
    return rendered(
        "report.html",
        facts=facts,
        findings=findings,
        figures=figures,
        origin=_origin(facts),
        tiles=tiles(figures),
        timeline=_timeline(facts, findings),
        configuration=Markup("\n").join(map(printable, facts.configuration.text.split("\n"))),
        drawings={
            "where": _where(facts),
            "timing": _timing(facts, findings),
            "sensors": _sensors(facts, findings),
            "filter": _filter(facts, findings),
            "clock": _clock(facts),
        },
        accuracy=[
            (label, f"{accuracy[key]:.3f} {unit}") for key, label, unit in ACCURACY if accuracy.get(key) is not None
        ],
        recognitions=[_recognition_row(each) for each in figures["recognitions"]],
        sensors=[_sensor_row(name, sensor) for name, sensor in figures["sensors"].items()],
        quality=", ".join(f"{word} {share:.1%}" for word, share in quality.items() if share),
        geometry=[_geometry_row(row) for row in figures["geometry"]],
        events=[(f"{e['time_s']:.2f}", e["severity"], f"{e['source']}.{e['kind']}", e["reason"]) for e in events],
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
        (f"{figures['landmarks']['confirmed']}", "landmarks in the map"),
    ]
    return [item for item in shown if item[0]]


def _origin(facts: RunFacts) -> str:
    version = facts.versions.get("infant", "")
    rover = f"rover {facts.configuration.rover}"
    parts = (facts.created_utc, facts.source, f"infant {version}" if version else "", rover)
    return ", ".join(part for part in parts if part)


def _marked(findings: Sequence[Finding], *beginnings: str) -> list[Interval]:
    """When the findings of these kinds were, for shading."""
    return [
        interval for finding in findings if finding.kind.startswith(beginnings) for interval in finding.intervals[:40]
    ]


def _timeline(facts: RunFacts, findings: Sequence[Finding]) -> Markup:
    """A bar for every finding that has times, in one picture: what came together belongs together."""
    rows = [
        (finding.kind.replace("_", " "), finding.severity.value, finding.intervals)
        for finding in findings
        if finding.intervals
    ]
    return Markup(timeline(rows, facts.duration_s) if rows else "")


def _where(facts: RunFacts) -> Drawings:
    ticks = facts.ticks
    lines = [
        Line("odometry alone", ticks.odometry[:, 0], ticks.odometry[:, 1], "path-b"),
        Line("published pose", ticks.estimated[:, 0], ticks.estimated[:, 1], "path-a"),
    ]
    known = np.isfinite(ticks.truth[:, 0])
    if known.any():
        lines.append(Line("truth", ticks.truth[:, 0], ticks.truth[:, 1], "path-c"))
    if facts.landmarks is not None:
        places_m = facts.landmarks.means_m
        lines.insert(0, Line("landmarks", places_m[:, 0], places_m[:, 1], "q", dots=True))
    drawings = {"Seen from above": Markup(map_plot(lines, "trajectory and landmarks"))}
    if known.any():
        errors = [
            Line(name, ticks.times_s, np.hypot(*(poses[:, :2] - ticks.truth[:, :2]).T), style)
            for name, poses, style in (
                ("published pose", ticks.estimated, "a"),
                ("odometry alone", ticks.odometry, "b"),
            )
        ]
        drawings["Distance from the truth"] = Markup(time_plot(errors, "error, m"))
    return drawings


def _timing(facts: RunFacts, findings: Sequence[Finding]) -> Drawings:
    ticks, marked = facts.ticks, _marked(findings, "missed")
    late = [Line("lateness", ticks.times_s, ticks.lateness_ms, "a")]
    stages = [
        Line(name, ticks.times_s, values, "abc"[index % 3])
        for index, (name, values) in enumerate(sorted(ticks.stages_ms.items(), reverse=True))
    ]
    return {
        "Wake-up after the grid point": Markup(time_plot(late, "lateness, ms", marked)),
        "Stages of a tick": Markup(time_plot(stages, "duration, ms")),
    }


def _sensors(facts: RunFacts, findings: Sequence[Finding]) -> Drawings:
    times_s, of_laser = facts.scans.times_s, _marked(findings, "laser", "scan")
    age = Line("age of the scan at its beat", times_s, facts.scans.age_s * 1e3, "a")
    beams = [
        Line("returned", times_s, facts.scans.returned_share * 100.0, "a"),
        Line("rejected: not seen before at that place", times_s, facts.scans.moved_share * 100.0, "b"),
    ]
    good_s = facts.wheels.times_s[facts.wheels.valid]
    spacing = Line("time between good samples", good_s[1:], np.diff(good_s) * 1e3, "a")
    of_wheels = _marked(findings, "wheel", "odometry")
    return {
        "Laser: age of scans": Markup(time_plot([age], "age, ms", of_laser)),
        "Laser: beams": Markup(time_plot(beams, "share, %", of_laser)),
        "Wheels: spacing of samples": Markup(time_plot([spacing], "spacing, ms", of_wheels)),
    }


def _recognition_row(found: dict[str, Any]) -> tuple[object, ...]:
    where = f"new map {found['map_id']}" if found["is_new"] else f"map {found['map_id']}"
    if found["joined"]:
        where += f", joined by map {found['joined']}"
    if found["is_new"]:
        return (f"{found['time_s']:.1f}", where, "", "", "", "")
    mirror = "" if found["mirror_odds"] is None else f"{found['mirror_odds']:.0f}"
    moved = f"{found['moved_m']:.2f} m, {found['turned_deg']:.0f} deg"
    return (f"{found['time_s']:.1f}", where, found["matches"], f"{found['odds']:.0f}", mirror, moved)


def _sensor_row(name: str, sensor: dict[str, Any]) -> tuple[object, ...]:
    rate = f"{sensor['usual_rate_hz']} Hz" if sensor["usual_rate_hz"] else ""
    silent = ", ".join(span_text((start, end)) for start, end in sensor["gaps_s"][:6]) or "never"
    return name, sensor["samples"], rate, silent


def _filter(facts: RunFacts, findings: Sequence[Finding]) -> Drawings:
    ticks, marked = facts.ticks, _marked(findings, "pose")
    nothing = np.full(ticks.times_s.size, np.nan)

    def counted(*names: str) -> list[Line]:
        lines = []
        for name, style in zip(names, ("a", "b", "c"), strict=False):
            values = ticks.counts.get(name, nothing)
            known = np.isfinite(values)
            lines.append(Line(name.replace("_", " "), ticks.times_s[known], values[known], style))
        return [line for line in lines if line.x.size]

    sure = ticks.position_sd_m < 100.0
    deviation = [
        Line("standard deviation", ticks.times_s[sure], ticks.position_sd_m[sure], "a"),
        Line("distance between both estimators", ticks.times_s, ticks.apart_m, "b"),
    ]
    drawings = {
        "Position": Markup(time_plot([line for line in deviation if line.x.size], "distance, m", marked)),
        "Effective particles": Markup(time_plot(counted("effective_particles"), "particles")),
        "Features and matches in a scan": Markup(time_plot(counted("features", "matched"), "number")),
        "Landmarks of the best particle": Markup(time_plot(counted("landmarks"), "number")),
    }
    if np.nan_to_num(ticks.counts.get("search_landmarks", nothing)).any():
        searched = counted("search_odds", "search_mirror_odds", "search_landmarks")
        drawings["Searching the known maps"] = Markup(time_plot(searched, "odds, landmarks"))
    return drawings


def _clock(facts: RunFacts) -> Drawings:
    """Empty where the bytes of the laser were not recorded."""
    clock = facts.device_clock
    driven = clock.arrival_s >= 0.0
    if not driven.any():
        return {}
    delay_ms = ((clock.arrival_s - clock.device_s) * 1e3)[driven]
    line = Line("arrival", clock.arrival_s[driven], delay_ms - delay_ms.min(), "a")
    drawing = Markup(time_plot([line], "arrival later than the fastest, ms"))
    return {"Laser: arrival against its own counter": drawing}


def _geometry_row(row: dict[str, Any]) -> tuple[str, ...]:
    interval = row["interval"]
    return (
        f"{row['label']}, {row['unit']}",
        f"{row['configured']:.1f}",
        "cannot tell" if interval is None else f"{interval[0]:.1f} to {interval[1]:.1f}",
        f"{row['detectable']:.1f}",
    )
