import xml.etree.ElementTree as ET

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime.report.plots import MOST_POINTS, Line, broken, map_plot, thinned, ticks, time_plot, timeline

TIMES_S: NDArray[np.float64] = np.linspace(0.0, 499.9, 5000)


@given(st.integers(0, 4999))
def test_a_single_peak_survives_thinning(peak: int) -> None:
    values = np.zeros(5000)
    values[peak] = 9.0
    x, y = thinned(TIMES_S, values)
    assert y.max() == 9.0
    assert x.size <= 2 * MOST_POINTS


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
def test_grid_lines_lie_within_and_are_few(low: float, span: float) -> None:
    values = ticks(low, low + span, 5)
    assert all(low - 1e-6 * span <= value <= low + span * (1 + 1e-6) for value in values)
    assert 1 <= len(values) <= 7


def test_a_line_is_not_drawn_across_a_silence() -> None:
    times_s = np.concatenate((np.arange(10) * 0.1, 5.0 + np.arange(10) * 0.1))
    _, values = broken(times_s, np.ones(20))
    assert np.isnan(values).sum() == 1
    assert time_plot([Line("a", times_s, np.ones(20), "a")], "m").count("M") >= 2


def test_plots_are_well_formed_and_label_their_axes() -> None:
    drawing = time_plot([Line("late", TIMES_S, np.sin(TIMES_S), "a")], "lateness, ms", [(3.0, 4.0)])
    words = "".join(ET.fromstring(drawing).itertext())
    assert "time, s" in words
    assert "lateness, ms" in words


def test_a_map_has_one_scale_on_both_axes() -> None:
    corners = np.array(((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)))
    drawing = map_plot([Line("way", corners[:, 0], corners[:, 1], "path-a")], "map")
    path = next(node for node in ET.fromstring(drawing) if node.get("class") == "curve path-a")
    (x0, y0), (x1, _), (_, y2) = (tuple(map(float, p.split())) for p in path.get("d", "")[1:].split("L"))
    assert abs((x1 - x0) - (y0 - y2)) < 0.3


def test_nothing_recorded_is_said() -> None:
    assert "Nothing recorded" in time_plot([], "m")
    assert "Nothing recorded" in map_plot([], "m")


def test_a_timeline_has_a_bar_for_every_interval_at_its_time() -> None:
    rows = [("laser silent", "warn", [(0.0, 50.0), (90.0, 90.0)]), ("people", "info", [(-3.0, 100.0)])]
    drawing = ET.fromstring(timeline(rows, 100.0))
    bars = [node for node in drawing if (node.get("class") or "").startswith("bar")]
    assert [node.get("class") for node in bars] == ["bar warn", "bar warn", "bar info"]
    widths = [float(node.get("width", "")) for node in bars]
    assert abs(widths[2] - 2.0 * widths[0]) < 0.2
    assert widths[1] >= 3.0  # a moment is seen too
    assert "laser silent" in "".join(drawing.itertext())


def test_a_map_shows_the_way_large_and_counts_the_landmarks_that_lie_far_from_it() -> None:
    way = Line("way", np.array((0.0, 10.0)), np.array((0.0, 0.0)), "path-a")
    marks = Line("landmarks", np.array((1.0, 5.0, 900.0)), np.array((2.0, -2.0, 0.0)), "q", dots=True)
    drawing = map_plot([marks, way], "map")
    assert drawing.count("<circle") == 2
    assert "landmarks (2 of 3 are this near)" in drawing
    start, end = (float(point.split()[0]) for point in drawing.split('path-a" d="M')[1].split('"')[0].split("L"))
    assert end - start > 200.0
