import re
from typing import Any

import numpy as np
from bokeh.models import HoverTool
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.renderers import GlyphRenderer
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from runtime.report.plots.plots import MOST_POINTS, Line, Plots, broken, embedded, in_reach, legend, thinned

TIMES_S: NDArray[np.float64] = np.linspace(0.0, 499.9, 5000)


@given(st.integers(0, 4999))
def test_a_single_peak_survives_thinning(peak: int) -> None:
    values = np.zeros(5000)
    values[peak] = 9.0
    x, y = thinned(TIMES_S, values)
    assert y.max() == 9.0
    assert x.size <= 2 * MOST_POINTS


def test_a_line_is_not_drawn_across_a_silence() -> None:
    times_s = np.concatenate((np.arange(10) * 0.1, 5.0 + np.arange(10) * 0.1))
    x, values = broken(times_s, np.ones(20))
    assert np.isnan(values).sum() == 1
    assert x.size == 21


def test_plots_over_time_move_together_and_show_what_is_marked() -> None:
    plots = Plots(500.0)
    late = plots.over_time([Line("late", TIMES_S, np.sin(TIMES_S), "a")], "lateness, ms", [(3.0, 4.0)])
    other = plots.over_time([Line("age", TIMES_S, np.cos(TIMES_S), "b")], "age, ms")
    assert late.x_range is other.x_range
    assert (late.xaxis.axis_label, late.yaxis.axis_label) == ("time, s", "lateness, ms")
    marks = [box for box in late.center if isinstance(box, BoxAnnotation) and box.name != "picked"]
    assert [(mark.left, mark.right) for mark in marks] == [(3.0, 4.0)]
    assert [box.name for box in other.center if isinstance(box, BoxAnnotation)] == ["picked"]


def test_a_map_has_one_scale_and_begins_where_the_curves_are() -> None:
    way = Line("way", np.array((0.0, 10.0)), np.array((0.0, 2.0)), "a")
    marks = Line("landmarks", np.array((1.0, 5.0, 900.0)), np.array((2.0, -2.0, 0.0)), "q", dots=True)
    drawn = Plots(10.0).over_ground([way, marks], np.array((0.0, 10.0)))
    assert drawn.match_aspect
    shown, reach = drawn.x_range.renderers
    assert shown.name == "way"
    assert reach.data_source.data["x"].tolist() == [0.0, 10.0]  # a landmark 900 m away does not make the way a dot
    sources: list[Any] = [(r.name, r.data_source) for r in drawn.renderers if isinstance(r, GlyphRenderer) and r.name]
    sizes = {name: len(source.data["x"]) for name, source in sources}
    assert sizes == {"way": 2, "landmarks": 3, "in reach": 2}  # and is there all the same


def test_the_map_of_a_short_drive_shows_the_landmarks_around_it() -> None:
    way = Line("way", np.array((0.0, 2.0)), np.array((0.0, 1.0)), "a")
    marks = Line("landmarks", np.array((-6.0, 9.0, 40.0)), np.array((3.0, -8.0, 0.0)), "q", dots=True)
    np.testing.assert_array_equal(in_reach([way, marks]), ((-6.0, -8.0), (9.0, 3.0)))


def test_what_the_pointer_shows_has_its_name_and_no_word_of_the_library() -> None:
    plots = Plots(10.0)
    way = Line("way", np.array((0.0, 10.0)), np.array((0.0, 2.0)), "a")
    posts = Line("landmarks", way.x, way.y, "q", dots=True)
    drawn = (
        plots.over_time([way], "m"),
        plots.over_ground([way, posts], way.x),
        plots.timeline([("laser silent", "warn", [(1.0, 2.0)])]),
    )
    shown = [row for plot in drawn for tool in plot.select(HoverTool) for row in tool.tooltips]
    assert len(shown) == 4
    assert not any("$" in label or "@" in label for label, _ in shown)  # of a label nothing is filled in
    assert all("$name" in value or "@name" in value for _, value in shown)


def test_nothing_recorded_is_said() -> None:
    plots = Plots(10.0)
    unknown = Line("a", np.arange(3.0), np.full(3, np.nan), "a")
    script, places = embedded({"curve": plots.over_time([unknown], "m"), "map": plots.over_ground([], None)})
    assert not script
    assert all("Nothing recorded" in place for place in places.values())


def test_the_library_is_in_the_page_and_asks_nothing_of_the_network() -> None:
    plots = Plots(10.0)
    script, places = embedded({"late": plots.over_time([Line("late", TIMES_S, TIMES_S, "a")], "ms")})
    assert "Bokeh" in script
    assert not re.search(r"<script[^>]*\ssrc|<link|cdn\.bokeh\.org/bokeh", script)
    assert places["late"].count("<div") == 1


def test_a_timeline_has_a_bar_for_every_interval_at_its_time() -> None:
    rows = [("laser silent", "warn", [(0.0, 50.0), (90.0, 90.0)]), ("people", "info", [(3.0, 100.0)])]
    drawn = Plots(100.0).timeline(rows)
    (bars,) = [renderer for renderer in drawn.renderers if renderer.name == "bars"]
    data = bars.data_source.data
    assert list(data["start"]) == [0.0, 90.0, 3.0]
    assert data["right"][1] > 90.0  # a moment is seen too
    assert data["name"] == ["laser silent", "laser silent", "people"]


def test_stages_on_top_of_each_other_add_up() -> None:
    step, read = Line("step", TIMES_S, np.full(5000, 3.0), "q"), Line("read", TIMES_S, np.full(5000, 1.0), "q")
    drawn = Plots(500.0).stacked([step, read], "ms")
    data = drawn.renderers[0].data_source.data
    assert np.all(data["s0"] + data["s1"] == 4.0)


def test_a_legend_names_several_curves_and_no_single_one() -> None:
    one, other = Line("<one>", TIMES_S, TIMES_S, "a"), Line("other", TIMES_S, TIMES_S, "b")
    assert legend([one]) == ""
    assert "&lt;one&gt;" in legend([one, other])
