"""Inline SVG plots: no script, no network, colours from the page's own style so that light and dark both work."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from drivers.measurements import FloatArray
from runtime.report.finding import Interval

MOST_POINTS = 600  # more than a phone or a printer shows; every bin keeps its least and its greatest
BREAK_S, BREAK_STEPS = 0.5, 5.0  # a longer pause than both of these parts a curve
TOP_OF_ROWS, ROW = 6.0, 31.0
NEAR_SHARE, NEAR_LEAST_M = 0.75, 5.0  # landmarks are drawn so far around the way; most lie far outside it
WIDTH, LEFT, RIGHT, TOP, BOTTOM = 640.0, 66.0, 20.0, 28.0, 40.0  # room for five digits at the size of a phone


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One curve or cloud: name for the legend, x and y (n,), style: a class of the page's style sheet."""

    name: str
    x: FloatArray
    y: FloatArray
    style: str
    dots: bool = False


@dataclass(frozen=True, slots=True)
class _Frame:
    """From values to places in the drawing."""

    low: tuple[float, float]
    high: tuple[float, float]
    height: float

    def x(self, value: float) -> float:
        return LEFT + (value - self.low[0]) / (self.high[0] - self.low[0]) * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        return (
            self.height - BOTTOM - (value - self.low[1]) / (self.high[1] - self.low[1]) * (self.height - TOP - BOTTOM)
        )


def time_plot(
    lines: Sequence[Line],
    y_label: str,
    marked: Sequence[Interval] = (),
    height: float = 210.0,
    from_zero: bool = True,
) -> str:
    """Curves over the seconds of the run; marked intervals are shaded."""
    drawn = [_driven(line) for line in lines if np.isfinite(line.y[line.x >= 0.0]).any()]
    if not drawn:
        return '<p class="quiet">Nothing recorded.</p>'
    values = np.concatenate([line.y[np.isfinite(line.y)] for line in drawn])
    low, high = (min(0.0, float(values.min())) if from_zero else float(values.min())), float(values.max())
    high = high if high > low else low + 1.0
    last_s = max(float(line.x.max()) for line in drawn)
    frame = _Frame((0.0, low), (max(last_s, 1.0), high + 0.08 * (high - low)), height)
    parts = [
        f'<rect class="marked" x="{frame.x(start):.1f}" y="{TOP:.0f}" '
        f'width="{max(2.0, frame.x(end) - frame.x(start)):.1f}" height="{height - TOP - BOTTOM:.0f}"/>'
        for start, end in marked
    ]
    parts += [_axes(frame, "time, s", y_label), *(_curve(line, frame) for line in drawn)]
    return _svg("".join(parts), height, y_label) + _legend(drawn)


def timeline(rows: Sequence[tuple[str, str, Sequence[Interval]]], until_s: float) -> str:
    """When each thing was: (name, style, intervals s since the first tick), one bar a row."""
    height = TOP_OF_ROWS + ROW * len(rows) + BOTTOM
    frame = _Frame((0.0, 0.0), (max(until_s, 1.0), 1.0), height)
    parts = [_across(frame, TOP_OF_ROWS, "time, s")]
    for row, (name, style, intervals) in enumerate(rows):
        y = TOP_OF_ROWS + ROW * row
        parts.append(f'<text class="name" x="{LEFT:.0f}" y="{y + 14:.0f}">{escape(name)}</text>')
        for start, end in intervals:
            x, width = frame.x(max(start, 0.0)), frame.x(end) - frame.x(max(start, 0.0))
            parts.append(
                f'<rect class="bar {style}" x="{x:.1f}" y="{y + 19:.0f}" width="{max(3.0, width):.1f}" height="7"/>'
            )
    return _svg("".join(parts), height, "when each finding was")


def _driven(line: Line) -> Line:
    """Without what came before the first tick."""
    during = line.x >= 0.0
    return Line(line.name, line.x[during], line.y[during], line.style, line.dots)


def map_plot(lines: Sequence[Line], label: str) -> str:
    """Places in metres, both axes to the same scale, x to the right and y up.

    The curves fill the drawing; of the dots those are drawn that lie around them, and the legend counts both.
    """
    drawn = [line for line in lines if line.x.size and np.isfinite(line.x).any()]
    if not drawn:
        return '<p class="quiet">Nothing recorded.</p>'
    curves = [line for line in drawn if not line.dots] or drawn
    (x0, x1), (y0, y1) = (_span([getattr(line, axis) for line in curves]) for axis in ("x", "y"))
    if len(curves) < len(drawn):
        margin = max(NEAR_LEAST_M, NEAR_SHARE * max(x1 - x0, y1 - y0))
        dots = [line for line in drawn if line.dots]
        (u0, u1), (v0, v1) = (_span([getattr(line, axis) for line in dots]) for axis in ("x", "y"))
        x0, x1 = min(x0, max(u0, x0 - margin)), max(x1, min(u1, x1 + margin))
        y0, y1 = min(y0, max(v0, y0 - margin)), max(y1, min(v1, y1 + margin))
        drawn = [_within(line, (x0, x1), (y0, y1)) if line.dots else line for line in drawn]
    scale = (WIDTH - LEFT - RIGHT) / (x1 - x0)
    height = (y1 - y0) * scale + TOP + BOTTOM
    if height > 620.0:
        more = (y1 - y0) * (WIDTH - LEFT - RIGHT) / (620.0 - TOP - BOTTOM) - (x1 - x0)
        x0, x1, height = x0 - 0.5 * more, x1 + 0.5 * more, 620.0
    frame = _Frame((x0, y0), (x1, y1), height)
    return _svg(_axes(frame, "x, m", "y, m") + "".join(_curve(line, frame) for line in drawn), height, label) + _legend(
        drawn
    )


def _span(values: Sequence[FloatArray]) -> Interval:
    """Least and greatest, with some room."""
    known = np.concatenate([part[np.isfinite(part)] for part in values])
    margin = max(0.5, 0.04 * float(np.ptp(known)))
    return float(known.min()) - margin, float(known.max()) + margin


def _within(line: Line, x: Interval, y: Interval) -> Line:
    inside = (line.x > x[0]) & (line.x < x[1]) & (line.y > y[0]) & (line.y < y[1])
    name = line.name if inside.all() else f"{line.name} ({int(inside.sum())} of {inside.size} are this near)"
    return Line(name, line.x[inside], line.y[inside], line.style, dots=True)


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


def ticks(low: float, high: float, about: int) -> list[float]:
    """Round numbers between low and high, about so many."""
    raw = (high - low) / about
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw)
    first = math.ceil(low / step - 1e-9)
    return [round(index * step, 10) for index in range(first, math.floor(high / step + 1e-9) + 1)]


def _axes(frame: _Frame, x_label: str, y_label: str) -> str:
    parts = []
    for value in ticks(frame.low[1], frame.high[1], max(2, round(frame.height / 45.0))):
        y = frame.y(value)
        parts.append(f'<path class="grid" d="M{LEFT:.0f} {y:.1f}H{WIDTH - RIGHT:.0f}"/>')
        parts.append(f'<text x="{LEFT - 5:.0f}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    parts.append(_across(frame, TOP, x_label))
    parts.append(f'<text x="2" y="{TOP - 9:.0f}">{escape(y_label)}</text>')
    return "".join(parts)


def _across(frame: _Frame, top: float, label: str) -> str:
    """Grid lines, numbers and label of the axis to the right."""
    bottom, parts = frame.height - BOTTOM, []
    for value in ticks(frame.low[0], frame.high[0], 7):
        x = frame.x(value)
        parts.append(f'<path class="grid" d="M{x:.1f} {top:.0f}V{bottom:.1f}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 15:.1f}" text-anchor="middle">{value:g}</text>')
    parts.append(f'<text x="{WIDTH - RIGHT:.0f}" y="{bottom + 34:.1f}" text-anchor="end">{escape(label)}</text>')
    return "".join(parts)


def _curve(line: Line, frame: _Frame) -> str:
    if line.dots or line.style.startswith("path"):
        x, y = line.x, line.y
    else:
        x, y = thinned(*broken(line.x, line.y))
    if line.dots:
        dots = "".join(
            f'<circle cx="{frame.x(a):.1f}" cy="{frame.y(b):.1f}" r="2.4"/>'
            for a, b in zip(x.tolist(), y.tolist(), strict=True)
        )
        return f'<g class="dots {line.style}">{dots}</g>'
    if x.size > 4 * MOST_POINTS:
        step = x.size // (2 * MOST_POINTS)
        x, y = x[::step], y[::step]
    words, pen_down = [], False
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            pen_down = False
            continue
        words.append(f"{'L' if pen_down else 'M'}{frame.x(a):.1f} {frame.y(b):.1f}")
        pen_down = True
    return f'<path class="curve {line.style}" d="{"".join(words)}"/>'


def _legend(lines: Sequence[Line]) -> str:
    if len(lines) < 2:
        return ""
    items = "".join(f'<li class="{line.style}{" dot" if line.dots else ""}">{escape(line.name)}</li>' for line in lines)
    return f'<ul class="legend">{items}</ul>'


def _svg(body: str, height: float, label: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" aria-label="{escape(label)}">{body}</svg>'
