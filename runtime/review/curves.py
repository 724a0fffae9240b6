"""The curves of a review: error, filter, loop and sensors over time."""

import math
from typing import Any

import rerun.blueprint as rrb

from runtime.review.columns import ReviewColumns
from runtime.review.ticks import AssembledTick
from slam.estimate import Estimate
from slam.pose import Pose2

PLOTS = {
    "effective_particles": "filter",
    "features": "filter",
    "matched": "filter",
    "landmarks": "map",
    "created": "map",
    "removed": "map",
}
"""On which plot a figure of the estimate stands; others are not drawn."""

WHOLE = ("step", "read")
"""Stages that stand beside the lateness; those that a step consists of, and what follows it, have their own plot."""


def draw_curves(columns: ReviewColumns, assembled: AssembledTick) -> None:
    """One point on each curve that has a value on this tick."""
    if assembled.timing is not None:
        columns.scalar("plots/timing/lateness_ms", assembled.timing.lateness_ns * 1e-6)
        for stage, duration_ns in assembled.timing.stages_ns.items():
            plot = "timing" if stage in WHOLE else "stages"
            columns.scalar(f"plots/{plot}/{stage.replace(' ', '_')}_ms", duration_ns * 1e-6)
    _draw_ages(columns, assembled)
    if assembled.estimate is not None:
        _draw_filter(columns, assembled.estimate)
        _draw_error(columns, assembled.estimate, assembled.truth)


def draw_speed(columns: ReviewColumns, before: Estimate, now: Estimate) -> None:
    """By dead reckoning, backwards negative."""
    span_s = (now.stamp_ns - before.stamp_ns) * 1e-9
    if 0.0 < span_s < 1.0:
        step = before.odom_from_body.inverse() @ now.odom_from_body
        columns.scalar("plots/motion/speed_mps", step.x_m / span_s)


def _draw_ages(columns: ReviewColumns, assembled: AssembledTick) -> None:
    """How old the newest sample of each sensor was when the tick was taken."""
    tick = assembled.tick
    if tick.scan is not None:
        columns.scalar("plots/sensors/laser_age_ms", (tick.stamp_ns - tick.scan.stamp_ns) * 1e-6)
    if tick.wheels:
        columns.scalar("plots/sensors/wheels_age_ms", (tick.stamp_ns - tick.wheels[-1].stamp_ns) * 1e-6)


def _draw_filter(columns: ReviewColumns, estimate: Estimate) -> None:
    for name, value in estimate.counts.items():
        if name in PLOTS:
            columns.scalar(f"plots/{PLOTS[name]}/{name}", value)


def _draw_error(columns: ReviewColumns, estimate: Estimate, truth: Pose2 | None) -> None:
    (xx, xy, _), (_, yy, _), _ = estimate.covariance.tolist()
    variance_m2 = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)  # of the larger axis
    if math.isfinite(variance_m2):
        columns.scalar("plots/error/2_sigma_m", 2.0 * math.sqrt(max(variance_m2, 0.0)))
    if truth is not None:
        for name, pose in (("SLAM", estimate.map_from_body), ("odometry", estimate.odom_from_body)):
            columns.scalar(f"plots/error/{name}_m", math.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m))


def curve_views(with_truth: bool, is_live: bool) -> Any:
    """The plots. is_live: without those of what a rover that drives does not tell."""
    error = "error (m): SLAM blue, odometry orange" if with_truth else "2 sigma of the position (m) grey"
    return rrb.Grid(
        _plot(error, "plots/error"),
        _plot("N eff violet, seen grey, matched green", "plots/filter"),
        _plot("ms: step blue, late yellow, read grey", "plots/timing"),
        rrb.Tabs(
            _plot("speed (m/s)", "plots/motion"),
            _plot("age (ms): laser white, wheels orange", "plots/sensors"),
            _plot("landmarks yellow, created green, removed red", "plots/map"),
            *(() if is_live else _from_the_record()),
        ),
        grid_columns=2,
    )


def _from_the_record() -> tuple[Any, ...]:
    return (
        _plot("stages (ms)", "plots/stages", with_legend=True),
        _plot("innovation (m): mean blue, RMS grey", "plots/innovation_range_m"),
        _plot("innovation (deg): mean blue, RMS grey", "plots/innovation_bearing_deg"),
        _plot("laser clock behind host (ms)", "plots/clock"),
    )


def _plot(name: str, origin: str, with_legend: bool = False) -> Any:
    """Without a legend, which would hide the curves: the title says what is what, and so does hovering."""
    always = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        plot_legend=rrb.PlotLegend(visible=with_legend),
        axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=always, end=always)),
    )
