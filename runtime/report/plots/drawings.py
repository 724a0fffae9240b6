"""What is drawn of a run, section by section of its page."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

from runtime.report.facts import RunFacts
from runtime.report.finding import Finding, Interval
from runtime.report.plots.plots import Line, Plots, embedded, legend, legend_of_stack

NOTHING = Markup()
MOST_STAGES = 7  # of a tick, in colours that can be told apart; the table has all


@dataclass(slots=True)
class Section:
    """Plots of one section: name: plot and what stands beneath it."""

    plots: dict[str, tuple[Any, Markup]] = field(default_factory=dict)

    def add(self, name: str, plot: Any, beneath: Markup = NOTHING) -> None:
        """One plot more."""
        self.plots[name] = (plot, beneath)


Placed = dict[str, dict[str, Markup]]


def placed(sections: dict[str, Section]) -> tuple[Markup, Placed]:
    """The script that draws all, and the place of each plot: section: name: markup."""
    flat = {f"{section}/{name}": plot for section, held in sections.items() for name, (plot, _) in held.plots.items()}
    script, places = embedded(flat)
    found = {
        section: {name: places[f"{section}/{name}"] + beneath for name, (_, beneath) in held.plots.items()}
        for section, held in sections.items()
    }
    return script, found


def drawings(facts: RunFacts, findings: Sequence[Finding], recognised_s: Sequence[float]) -> tuple[Markup, Placed]:
    """All plots of the page. recognised_s: when places were recognised."""
    plots = Plots(facts.duration_s)
    sections = {
        "timeline": _timeline(plots, findings),
        "where": _where(plots, facts, recognised_s),
        "timing": _timing(plots, facts, findings),
        "sensors": _sensors(plots, facts, findings),
        "filter": _filter(plots, facts, findings),
        "clock": _clock(plots, facts),
    }
    return placed(sections)


def over_time(
    plots: Plots, section: Section, name: str, lines: Sequence[Line], y_label: str, *marked: Interval
) -> None:
    """A plot of curves with its legend."""
    section.add(name, plots.over_time(lines, y_label, marked), legend(lines))


def _marked(findings: Sequence[Finding], *beginnings: str) -> list[Interval]:
    """When the findings of these kinds were, for shading."""
    return [
        interval for finding in findings if finding.kind.startswith(beginnings) for interval in finding.intervals[:40]
    ]


def _timeline(plots: Plots, findings: Sequence[Finding]) -> Section:
    """A bar for every finding that has times, in one picture: what came together belongs together."""
    section = Section()
    rows = [
        (finding.kind.replace("_", " "), finding.severity.value, finding.intervals)
        for finding in findings
        if finding.intervals
    ]
    if rows:
        section.add("when", plots.timeline(rows))
    return section


def _where(plots: Plots, facts: RunFacts, recognised_s: Sequence[float]) -> Section:
    ticks, section = facts.ticks, Section()
    way = ticks.estimated
    lines = [
        Line("published pose", way[:, 0], way[:, 1], "a"),
        Line("odometry alone", ticks.odometry[:, 0], ticks.odometry[:, 1], "b"),
    ]
    known = np.isfinite(ticks.truth[:, 0])
    if known.any():
        lines.append(Line("truth", ticks.truth[:, 0], ticks.truth[:, 1], "c"))
    if facts.landmarks is not None:
        places_m = facts.landmarks.means_m
        lines.append(Line("landmarks", places_m[:, 0], places_m[:, 1], "q", dots=True))
    lines += [_at("start", way[:1], "start"), _at("end", way[-1:], "end")]
    if len(recognised_s):
        rows = np.searchsorted(ticks.times_s, recognised_s).clip(0, len(way) - 1)
        lines.append(_at("place recognised", way[rows], "recognised"))
    seen_from_above = plots.over_ground(lines, ticks.times_s, facts.scan_picture)
    section.add("Seen from above", seen_from_above, legend(lines))
    if known.any():
        errors = [
            Line(name, ticks.times_s, np.hypot(*(poses[:, :2] - ticks.truth[:, :2]).T), style)
            for name, poses, style in (
                ("published pose", ticks.estimated, "a"),
                ("odometry alone", ticks.odometry, "b"),
            )
        ]
        over_time(plots, section, "Distance from the truth", errors, "error, m")
    return section


def _at(name: str, poses: Any, style: str) -> Line:
    return Line(name, poses[:, 0], poses[:, 1], style, dots=True)


def _timing(plots: Plots, facts: RunFacts, findings: Sequence[Finding]) -> Section:
    ticks, section = facts.ticks, Section()
    late = [Line("lateness", ticks.times_s, ticks.lateness_ms, "a")]
    over_time(plots, section, "Delay of each beat", late, "lateness, ms", *_marked(findings, "missed", "late"))
    stages = [Line(name, ticks.times_s, values, "q") for name, values in parts_of_a_tick(facts)]
    shown = plots.stacked(stages, "duration, ms")
    section.add("Stages of a tick", shown, legend_of_stack([line.name for line in stages]))
    return section


def parts_of_a_tick(facts: RunFacts) -> list[tuple[str, Any]]:
    """The longest stages by name, ms (ticks,) each, the rest as one; `step` is the sum of others and left out."""
    parts = {name: values for name, values in facts.ticks.stages_ms.items() if name != "step" or not _has_parts(facts)}
    order = sorted(parts, key=lambda name: -float(np.nan_to_num(np.nanmedian(parts[name]))))
    shown = [(name, parts[name]) for name in order[:MOST_STAGES]]
    if rest := order[MOST_STAGES:]:
        shown.append((f"{len(rest)} others", np.nansum([parts[name] for name in rest], axis=0)))
    return shown


def _has_parts(facts: RunFacts) -> bool:
    return "front end" in facts.ticks.stages_ms


def _sensors(plots: Plots, facts: RunFacts, findings: Sequence[Finding]) -> Section:
    section = Section()
    times_s, of_laser = facts.scans.times_s, _marked(findings, "laser", "scan")
    age = Line("age of the scan at its beat", times_s, facts.scans.age_s * 1e3, "a")
    beams = [
        Line("returned", times_s, facts.scans.returned_share * 100.0, "a"),
        Line("rejected: not seen before at that place", times_s, facts.scans.moved_share * 100.0, "b"),
    ]
    good_s = facts.wheels.times_s[facts.wheels.valid]
    spacing = Line("time between good samples", good_s[1:], np.diff(good_s) * 1e3, "a")
    over_time(plots, section, "Laser: age of scans", [age], "age, ms", *of_laser)
    over_time(plots, section, "Laser: beams", beams, "share, %", *of_laser)
    over_time(
        plots, section, "Wheels: spacing of samples", [spacing], "spacing, ms", *_marked(findings, "wheel", "odometry")
    )
    return section


def _filter(plots: Plots, facts: RunFacts, findings: Sequence[Finding]) -> Section:
    ticks, marked, section = facts.ticks, _marked(findings, "pose"), Section()
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
        Line("distance between the two estimators", ticks.times_s, ticks.apart_m, "b"),
    ]
    over_time(plots, section, "Position", [line for line in deviation if line.x.size], "distance, m", *marked)
    over_time(plots, section, "Effective particles", counted("effective_particles"), "particles")
    over_time(plots, section, "Features and matches in a scan", counted("features", "matched"), "number")
    over_time(plots, section, "Landmarks of the best particle", counted("landmarks"), "number")
    if any(np.nan_to_num(ticks.counts.get(name, nothing)).any() for name in ("search_landmarks", "search_scan_odds")):
        searched = counted("search_odds", "search_mirror_odds", "search_scan_odds")
        over_time(plots, section, "Searching the known maps", searched, "odds")
    return section


def _clock(plots: Plots, facts: RunFacts) -> Section:
    """Empty where the bytes of the laser were not recorded."""
    clock, section = facts.device_clock, Section()
    driven = clock.arrival_s >= 0.0
    if driven.any():
        delay_ms = ((clock.arrival_s - clock.device_s) * 1e3)[driven]
        line = Line("arrival", clock.arrival_s[driven], delay_ms - delay_ms.min(), "a")
        over_time(plots, section, "Laser: arrival against its own counter", [line], "later than the fastest, ms")
    return section
