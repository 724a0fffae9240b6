"""report.html: one self-contained page of a run; nothing in it asks the network for anything."""

import html
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, Interval, span_text
from runtime.report.plots import Line, map_plot, time_plot, timeline
from runtime.report.style import STYLE

KEY = re.compile(
    r"(\[[a-z_]+(\.[a-z_]+)*\]|[a-z_]+(\.[a-z_0-9]+)+|\b[a-z]+(_[a-z0-9]+)+)"  # a table, a full name, or its last part
    r"( = [-+\d.]*\d| = (true|false))?"  # and the value it is to have
)
NOTHING = "<p>Nothing was found.</p>"


def page(facts: RunFacts, findings: Sequence[Finding], figures: dict[str, Any]) -> str:
    """The whole page."""
    body = "".join(
        (
            f"<h1>{text(facts.name)}</h1>",
            f'<p class="quiet">{text(_origin(facts))}</p>',
            verdict_line(figures),
            f'<div class="tiles">{"".join(tile(*item) for item in tiles(figures))}</div>',
            section("Findings", _when(facts, findings) + "".join(map(finding_card, findings)) or NOTHING),
            section("Trajectory and map", _where(facts, figures)),
            section("Timing", _timing(facts, findings)),
            section("Sensors", _sensors(facts, figures, findings)),
            section("Filter", _filter(facts, figures, findings)),
            section("Clock", _clock(facts)),
            section("Geometry", _geometry(figures)),
            section("Events", _events(figures)),
            section("Configuration", _configuration(facts)),
        )
    )
    return document(f"Review of {facts.name}", body)


def document(title: str, body: str) -> str:
    """An HTML page of its own."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{text(title)}</title>'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<style>{STYLE}</style></head><body>{body}</body></html>\n"
    )


def text(value: object) -> str:
    """Escaped for HTML."""
    return html.escape(str(value))


def section(title: str, body: str) -> str:
    """A heading and what stands under it."""
    return f"<section><h2>{text(title)}</h2>{body}</section>"


def verdict_line(figures: dict[str, Any]) -> str:
    """The verdict in its colour."""
    return f'<p class="verdict {figures["severity"]}">This run is <b>{text(figures["verdict"])}</b>.</p>'


def tile(value: str, caption: str) -> str:
    """One figure with what it is."""
    return f'<div class="tile"><b>{text(value)}</b><span>{text(caption)}</span></div>'


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
            "RMS error of the wheels alone",
        ),
        (f"{timing['rate_hz']:.2f} Hz" if timing["rate_hz"] else "", "rate of the loop"),
        (f"{timing['missed']} of {timing['ticks'] + timing['missed']}" if late else "", "beats missed"),
        (f"{late['p99']:.2f} ms" if late else "", "lateness, 99 %"),
        (f"{laser['samples']}", "scans"),
        (f"{figures['landmarks']['confirmed']}", "landmarks in the map"),
    ]
    return [item for item in shown if item[0]]


def finding_card(finding: Finding) -> str:
    """One finding with evidence, cause and remedy."""
    evidence = "<br>".join(text(line) for line in finding.evidence)
    return (
        f'<article class="finding {finding.severity.value}" data-kind="{text(finding.kind)}">'
        f'<span class="mark">{finding.severity.value}</span><h3>{text(finding.title)}</h3><dl>'
        f"<dt>Evidence</dt><dd>{evidence}</dd><dt>Likely</dt><dd>{text(finding.cause)}</dd>"
        f"<dt>Change</dt><dd>{keys_marked(finding.remedy)}</dd></dl></article>"
    )


def keys_marked(sentence: str) -> str:
    """A remedy with its configuration keys, and the values that they are to have, as code."""
    return KEY.sub(lambda found: f"<code>{found.group(0)}</code>", text(sentence))


def plot(title: str, drawing: str) -> str:
    """A drawing under its name."""
    return f"<div><h3>{text(title)}</h3>{drawing}</div>"


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Scrolls by itself where the page is too narrow for it."""
    cells = "".join("<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    names = "".join(f"<th>{text(name)}</th>" for name in head)
    return f'<div class="scroll"><table><tr>{names}</tr>{cells}</table></div>'


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


def _when(facts: RunFacts, findings: Sequence[Finding]) -> str:
    """A bar for every finding that has times, in one picture: what came together belongs together."""
    rows = [
        (finding.kind.replace("_", " "), finding.severity.value, finding.intervals)
        for finding in findings
        if finding.intervals
    ]
    return f'<div class="when">{timeline(rows, facts.duration_s)}</div>' if rows else ""


def _where(facts: RunFacts, figures: dict[str, Any]) -> str:
    ticks, accuracy = facts.ticks, figures["accuracy"]
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
    drawings = plot("Seen from above", map_plot(lines, "trajectory and landmarks"))
    if known.any():
        errors = [
            Line(name, ticks.times_s, np.hypot(*(poses[:, :2] - ticks.truth[:, :2]).T), style)
            for name, poses, style in (
                ("published pose", ticks.estimated, "a"),
                ("odometry alone", ticks.odometry, "b"),
            )
        ]
        drawings += plot("Distance from the truth", time_plot(errors, "error, m"))
    rows = [
        (label, f"{accuracy[key]:.3f} {unit}")
        for key, label, unit in (
            ("rms_m", "RMS error", "m"),
            ("trimmed_rms_m", "RMS error, best 95 %", "m"),
            ("max_m", "largest error", "m"),
            ("odometry_rms_m", "RMS error of odometry alone", "m"),
            ("relation_translation_m", "relations, translation", "m"),
            ("relation_rotation_deg", "relations, rotation", "deg"),
        )
        if accuracy.get(key) is not None
    ]
    born = figures["landmarks"]
    note = (
        f'<p class="quiet">Truth: {text(accuracy["truth"])}. Landmarks: {born["born"]} born, {born["removed"]} removed '
        f"again, {born['confirmed']} in the published map.</p>"
    )
    return f'<div class="pair">{drawings}</div>' + (table(("against the truth", ""), rows) if rows else "") + note


def _timing(facts: RunFacts, findings: Sequence[Finding]) -> str:
    ticks, marked = facts.ticks, _marked(findings, "missed")
    late = time_plot([Line("lateness", ticks.times_s, ticks.lateness_ms, "a")], "lateness, ms", marked)
    styles = ("a", "b", "c")
    stages = [
        Line(name, ticks.times_s, values, styles[index % 3])
        for index, (name, values) in enumerate(sorted(ticks.stages_ms.items(), reverse=True))
    ]
    drawings = plot("Wake-up after the grid point", late) + plot("Stages of a tick", time_plot(stages, "duration, ms"))
    return f'<div class="pair">{drawings}</div>'


def _sensors(facts: RunFacts, figures: dict[str, Any], findings: Sequence[Finding]) -> str:
    age = Line("age of the scan at its beat", facts.scans.times_s, facts.scans.age_s * 1e3, "a")
    moved = [
        Line("came back", facts.scans.times_s, facts.scans.returned_share * 100.0, "a"),
        Line("refused: not seen before at that place", facts.scans.times_s, facts.scans.moved_share * 100.0, "b"),
    ]
    good_s = facts.wheels.times_s[facts.wheels.valid]
    apart = Line("time between good samples", good_s[1:], np.diff(good_s) * 1e3, "a")
    drawings = (
        plot("Laser: age of scans", time_plot([age], "age, ms", _marked(findings, "laser", "scan")))
        + plot("Laser: beams", time_plot(moved, "share, %", _marked(findings, "laser", "scan")))
        + plot("Wheels: spacing of samples", time_plot([apart], "spacing, ms", _marked(findings, "wheel", "odometry")))
    )
    rows = [
        (
            name,
            sensor["samples"],
            f"{sensor['usual_rate_hz']} Hz" if sensor["usual_rate_hz"] else "",
            ", ".join(span_text((start, end)) for start, end in sensor["gaps_s"][:6]) or "none",
        )
        for name, sensor in figures["sensors"].items()
    ]
    return table(("sensor", "samples", "usual rate", "silent"), rows) + f'<div class="pair">{drawings}</div>'


def _filter(facts: RunFacts, figures: dict[str, Any], findings: Sequence[Finding]) -> str:
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
        Line("both estimators apart", ticks.times_s, ticks.apart_m, "b"),
    ]
    drawings = (
        plot("Position", time_plot([line for line in deviation if line.x.size], "distance, m", marked))
        + plot("Effective particles", time_plot(counted("effective_particles"), "particles"))
        + plot("Features and matches in a scan", time_plot(counted("features", "matched"), "number"))
        + plot("Landmarks of the best particle", time_plot(counted("landmarks"), "number"))
    )
    shares = ", ".join(f"{word} {share:.1%}" for word, share in figures["filter"]["quality_share"].items() if share)
    return f'<p class="quiet">Quality of the pose: {text(shares)}.</p><div class="pair">{drawings}</div>'


def _clock(facts: RunFacts) -> str:
    clock = facts.device_clock
    if not (clock.arrival_s >= 0.0).any():
        return '<p class="quiet">The bytes of the laser were not recorded, so its own clock is not known.</p>'
    delay_ms = (clock.arrival_s - clock.device_s) * 1e3
    driven = clock.arrival_s >= 0.0
    line = Line("arrival", clock.arrival_s[driven], delay_ms[driven] - delay_ms[driven].min(), "a")
    drawing = time_plot([line], "arrival later than the fastest, ms")
    return f'<div class="pair">{plot("Laser: arrival against its own counter", drawing)}</div>'


def _geometry(figures: dict[str, Any]) -> str:
    rows = [
        (
            f"{row['label']}, {row['unit']}",
            f"{row['configured']:.1f}",
            "cannot tell" if row["interval"] is None else f"{row['interval'][0]:.1f} to {row['interval'][1]:.1f}",
            f"{row['detectable']:.1f}",
        )
        for row in figures["geometry"]
    ]
    if not rows:
        return '<p class="quiet">Nothing to compare: wheels and laser were not seen in motion together.</p>'
    note = (
        '<p class="quiet">The interval holds with everything else open as well. A single deviation of the last column '
        "would have become a finding in one of two such runs; a longer drive tells smaller ones.</p>"
    )
    return table(("", "configured", "this run says (95 %)", "tells from"), rows) + note


def _events(figures: dict[str, Any]) -> str:
    events = figures["events"]
    if not events["total"]:
        return '<p class="quiet">None.</p>'
    rows = [(f"{e['time_s']:.2f}", e["severity"], f"{e['source']}.{e['kind']}", e["reason"]) for e in events["first"]]
    more = events["total"] - len(rows)
    note = f'<p class="quiet">And {more} more in run.mcap.</p>' if more else ""
    return f'<div class="events">{table(("s", "", "kind", "reason"), rows)}</div>' + note


def _configuration(facts: RunFacts) -> str:
    return (
        f'<p class="quiet">sha256 {facts.configuration.sha256}</p><details><summary>As it was in force</summary>'
        f"<pre><code>{text(facts.configuration.text)}</code></pre></details>"
    )
