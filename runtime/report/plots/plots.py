"""Plots that can be zoomed and read with the pointer; bokeh, which draws them, goes into the page with them.

All plots over time share one range, one crosshair and one mark, which a finding's button sets (templates/plots.js).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.embed import components
from bokeh.models import BoxZoomTool, ColumnDataSource, CrosshairTool, CustomJS, DataRange1d, HoverTool, Range1d
from bokeh.models.annotations import BoxAnnotation, Label, Span
from bokeh.plotting import figure
from bokeh.resources import Resources
from markupsafe import Markup

from drivers.measurements import FloatArray
from runtime.maps.scan_picture import ScanPicture
from runtime.report.finding import Interval

MOST_POINTS = 1500  # of a curve; every bin keeps its least and its greatest
MOST_PLACES = 4000  # of a path
REACH_M = 10.0  # around the path in which landmarks are shown from the start; a path of a few metres has none beside it
BREAK_S, BREAK_STEPS = 0.5, 5.0  # a longer pause than both of these parts a curve
ROW_PX, HEIGHT_PX, MAP_PX = 34, 230, 560
LEFT_PX = 14  # of a plot without an axis there, for half of the first label beneath
QUIET, GRID, MARK = "#7b8792", "#7b879240", "#e0a030"  # seen on white and on black
COLOURS = {"a": "#2f86dc", "b": "#dd6f1a", "c": "#36a04c", "q": "#16a3a3", "info": "#5b82ab", "warn": "#c98a1b"}
COLOURS |= {"error": "#d9483b", "start": "#36a04c", "end": "#d9483b", "recognised": "#a05bd0", "people": "#c98a1b"}
DASHES = {"a": "solid", "b": "dashed", "c": "dotted"}
STAGES = ("#2f86dc", "#dd6f1a", "#36a04c", "#a05bd0", "#d9483b", "#16a3a3", "#b38a2e", QUIET)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One curve or cloud: name for the legend, x and y (n,), style: a key of COLOURS."""

    name: str
    x: FloatArray
    y: FloatArray
    style: str
    dots: bool = False


class Plots:
    """Plots of one page, and what they have in common."""

    def __init__(self, duration_s: float) -> None:
        """duration_s: of the longest run on the page."""
        self._duration_s = max(duration_s, 1.0)
        self._time = Range1d(start=0.0, end=max(duration_s, 1.0), name="time", bounds=(-5.0, duration_s + 5.0))
        self._crosshair = CrosshairTool(overlay=Span(dimension="height", line_color=QUIET))
        self._picked = BoxAnnotation(
            name="picked", left=0.0, right=0.0, fill_color=MARK, fill_alpha=0.35, line_color=MARK, visible=False
        )

    def over_time(self, lines: Sequence[Line], y_label: str, marked: Sequence[Interval] = ()) -> Any:
        """Curves over the seconds of the run; marked intervals are shaded. None where nothing was recorded."""
        drawn = [_driven(line) for line in lines]
        drawn = [line for line in drawn if np.isfinite(line.y).any()]
        if not drawn:
            return None
        plot = self._figure(y_label)
        for start, end in marked:
            plot.add_layout(BoxAnnotation(left=start, right=max(end, start + 0.05), fill_color=MARK, fill_alpha=0.16))
        for line in drawn:
            x, y = thinned(*broken(line.x, line.y))
            curve = plot.line(x, y, name=line.name, color=COLOURS[line.style], line_dash=DASHES[line.style])
            curve.glyph.line_width = 1.6
        plot.add_tools(HoverTool(mode="vline", tooltips=[("", "$name: @y{0.[000]} at @x{0.0} s")]))
        return plot

    def stacked(self, lines: Sequence[Line], y_label: str) -> Any:
        """Parts of a sum, at the same seconds each, on top of each other: medians of short stretches."""
        if not lines:
            return None
        plot = self._figure(y_label)
        bins = np.array_split(np.arange(lines[0].x.size), min(lines[0].x.size, MOST_POINTS // 2))
        columns = {"x": np.array([lines[0].x[part].mean() for part in bins])}
        for index, line in enumerate(lines):
            values = np.nan_to_num(line.y)
            columns[f"s{index}"] = np.array([np.median(values[part]) for part in bins])
        colours = stage_colours(len(lines))
        names = [f"s{index}" for index in range(len(lines))]
        source = ColumnDataSource(columns)
        plot.varea_stack(names, x="x", source=source, color=colours, alpha=0.85)
        top = plot.line("x", "s0", source=source, alpha=0.0)
        said = [(line.name, f"@{name}{{0.00}}") for name, line in zip(names, lines, strict=True)]
        plot.add_tools(HoverTool(mode="vline", renderers=[top], tooltips=[("s", "@x{0.0}"), *said]))
        return plot

    def timeline(self, rows: Sequence[tuple[str, str, Sequence[Interval]]]) -> Any:
        """When each thing was: (name, style, intervals s since the first tick), one row each."""
        plot = self._figure("", height=ROW_PX * len(rows) + 70)
        plot.y_range = Range1d(start=len(rows), end=0.0)
        plot.yaxis.visible = plot.ygrid.visible = False
        plot.min_border_left = LEFT_PX
        spans = [(row, name, style, *interval) for row, (name, style, all_) in enumerate(rows) for interval in all_]
        least_s = self._duration_s * 0.004
        source = {
            "y": [row + 0.72 for row, *_ in spans],
            "name": [name for _, name, *_ in spans],
            "color": [COLOURS[style] for _, _, style, *_ in spans],
            "start": [start for *_, start, _ in spans],
            "end": [end for *_, end in spans],
            "right": [max(end, start + least_s) for *_, start, end in spans],
        }
        bars = plot.hbar(
            y="y", left="start", right="right", height=0.34, color="color", source=ColumnDataSource(source), name="bars"
        )
        for row, (name, *_) in enumerate(rows):
            plot.add_layout(
                Label(x=4, x_units="screen", y=row + 0.5, text=name, text_font_size="12px", text_color=QUIET)
            )
        plot.add_tools(HoverTool(renderers=[bars], tooltips=[("", "@name: @start{0.0} to @end{0.0} s")]))
        return plot

    def over_ground(self, lines: Sequence[Line], times_s: FloatArray | None, scans: ScanPicture | None = None) -> Any:
        """Places in metres, x to the right and y up, to one scale; curves and what is in their reach fill the plot.

        times_s: of the first curve's points; then the place of the rover follows the pointer over the other plots.
        """
        drawn = [line for line in lines if line.x.size and np.isfinite(line.x).any()]
        if not drawn:
            return None
        ranges = [DataRange1d(range_padding=0.12) for _ in "xy"]
        plot = figure(
            height=MAP_PX,
            sizing_mode="stretch_width",
            match_aspect=True,
            x_range=ranges[0],
            y_range=ranges[1],
            tools="pan,wheel_zoom,reset,save",
            active_drag=None,
            active_scroll=None,
            output_backend="canvas",
        )
        plot.add_tools(BoxZoomTool(match_aspect=True))
        _quiet(plot, "x, m", "y, m")
        if scans is not None:
            plot.image_url([scans.url], scans.x_m, scans.y_m, scans.width_m, scans.height_m, anchor="bottom_left")
        path = None
        for line in drawn:
            if line.dots:
                size, edge = (5, None) if line.style == "q" else (11, "#ffffff")
                dots = plot.scatter(
                    line.x, line.y, name=line.name, size=size, color=COLOURS[line.style], line_color=edge
                )
                plot.add_tools(HoverTool(renderers=[dots], tooltips=[("", "$name: (@x{0.00}, @y{0.00}) m")]))
                continue
            step = max(1, line.x.size // MOST_PLACES)
            columns = {"x": line.x[::step], "y": line.y[::step]}
            with_times = path is None and times_s is not None
            if with_times:
                assert times_s is not None
                columns["t"] = times_s[::step]
            source = ColumnDataSource(columns)
            curve = plot.line("x", "y", source=source, name=line.name, color=COLOURS[line.style], line_width=1.8)
            curve.glyph.line_dash = DASHES[line.style]
            if with_times:
                path, source.name = curve, "path"
                said = [("", "$name: (@x{0.00}, @y{0.00}) m at @t{0.0} s")]
                plot.add_tools(HoverTool(renderers=[curve], tooltips=said, line_policy="nearest"))
        curves = [
            glyph for glyph in plot.renderers if getattr(glyph, "name", None) in {x.name for x in drawn if not x.dots}
        ]
        corners_m = in_reach(drawn)
        frame = plot.scatter(corners_m[:, 0], corners_m[:, 1], name="in reach", alpha=0.0)
        for shown in ranges:
            shown.renderers = [*curves, frame] if curves else "auto"
        picked = ColumnDataSource({"x": [], "y": []}, name="picked path")
        plot.line("x", "y", source=picked, color=MARK, line_width=5, alpha=0.8)
        here = ColumnDataSource({"x": [], "y": []}, name="here")
        plot.scatter("x", "y", source=here, size=13, color=None, line_color=MARK, line_width=3)
        return plot

    def _figure(self, y_label: str, height: int = HEIGHT_PX) -> Any:
        plot = figure(
            height=height,
            sizing_mode="stretch_width",
            x_range=self._time,
            tools="xpan,xwheel_zoom,reset,save",
            active_drag=None,
            active_scroll=None,
            output_backend="canvas",
        )
        plot.add_tools(BoxZoomTool(dimensions="width"), self._crosshair)
        plot.add_layout(self._picked)
        plot.js_on_event("mousemove", CustomJS(code="window.rover_at?.(cb_obj.x)"))
        _quiet(plot, "time, s", y_label)
        return plot


def embedded(plots: Mapping[str, Any]) -> tuple[Markup, dict[str, Markup]]:
    """The library with what it draws, and the place of each plot in the page by name; nothing asks the network."""
    known = {name: plot for name, plot in plots.items() if plot is not None}
    places = {name: Markup('<p class="quiet">Nothing recorded.</p>') for name in plots}
    if not known:
        return Markup(), places
    together = Document()
    with together.models.freeze():  # else the library looks through all plots again with each that is added
        for plot in known.values():
            together.add_root(plot)
    script, divs = components(known)
    library = Resources(mode="inline", components=["bokeh"]).render_js()
    # the library's own markup: names of runs and what devices say are in no plot
    drawn = {name: Markup(div) for name, div in divs.items()}  # noqa: S704
    return Markup(library + script), places | drawn  # noqa: S704


def legend(lines: Sequence[Line]) -> Markup:
    """Names and colours beneath a plot; nothing for a single curve."""
    names = [line for line in lines if line.x.size and np.isfinite(line.y).any()]
    items = [
        Markup('<li class="{}" style="--own:{}">{}</li>').format(
            "dot" if line.dots else line.style, COLOURS[line.style], line.name
        )
        for line in names
    ]
    return Markup('<ul class="legend">{}</ul>').format(Markup().join(items)) if len(items) > 1 else Markup()


def legend_of_stack(names: Sequence[str]) -> Markup:
    """Names and colours beneath a stack."""
    items = [
        Markup('<li class="a" style="--own:{}">{}</li>').format(colour, name)
        for name, colour in zip(names, stage_colours(len(names)), strict=True)
    ]
    return Markup('<ul class="legend">{}</ul>').format(Markup().join(items))


def stage_colours(count: int) -> list[str]:
    """One for each part of a stack."""
    return [STAGES[index % len(STAGES)] for index in range(count)]


def in_reach(lines: Sequence[Line]) -> FloatArray:
    """Corners (2, 2) of the box around the first line and all dots that lie no farther than REACH_M beside it."""
    path_m = np.column_stack((lines[0].x, lines[0].y))
    low_m, high_m = np.nanmin(path_m, axis=0), np.nanmax(path_m, axis=0)
    dots_m = [np.column_stack((line.x, line.y)) for line in lines if line.dots]
    near_m = [m[((m >= low_m - REACH_M) & (m <= high_m + REACH_M)).all(axis=1)] for m in dots_m]
    places_m = np.concatenate(([low_m, high_m], *near_m))
    return np.array((places_m.min(axis=0), places_m.max(axis=0)))


def thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At most MOST_POINTS points: of every bin the least and the greatest, in their order, so no peak is lost."""
    if x.size <= MOST_POINTS:
        return x, y
    bins = np.array_split(np.arange(x.size), MOST_POINTS // 2)
    kept: list[int] = []
    for part in bins:
        known, unknown = part[np.isfinite(y[part])], part[np.isnan(y[part])]
        picked = {int(known[np.argmin(y[known])]), int(known[np.argmax(y[known])])} if known.size else set()
        kept += sorted(picked | {int(index) for index in unknown[:1]})
    return x[kept], y[kept]


def broken(times_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same with a NaN in each silence, so that no line is drawn where nothing was measured."""
    if times_s.size < 3:
        return times_s, values
    steps = np.diff(times_s)
    ends = np.flatnonzero(steps > max(BREAK_S, BREAK_STEPS * float(np.median(steps)))) + 1
    return np.insert(times_s, ends, times_s[ends - 1]), np.insert(values, ends, np.nan)


def _driven(line: Line) -> Line:
    """Without what came before the first tick."""
    during = line.x >= 0.0
    return Line(line.name, line.x[during], line.y[during], line.style, line.dots)


def _quiet(plot: Any, x_label: str, y_label: str) -> None:
    """Readable in light and in dark: no ground of its own, colours that are seen on both."""
    plot.background_fill_color = plot.border_fill_color = plot.outline_line_color = None
    plot.toolbar.logo, plot.toolbar.autohide = None, False
    plot.xaxis.axis_label, plot.yaxis.axis_label = x_label, y_label
    for axis in plot.axis:
        axis.axis_label_text_color = axis.major_label_text_color = axis.axis_line_color = QUIET
        axis.axis_label_text_font_style, axis.axis_label_text_font_size = "normal", "13px"
        axis.major_label_text_font_size, axis.major_tick_line_color, axis.minor_tick_line_color = "13px", QUIET, None
    plot.grid.grid_line_color = GRID
