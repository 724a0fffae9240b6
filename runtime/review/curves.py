"""The curves of a review: error, filter, loop and sensors over time."""

import math

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


def draw_curves(columns: ReviewColumns, assembled: AssembledTick) -> None:
    """One point on each curve that has a value on this tick."""
    if assembled.timing is not None:
        columns.scalar("plots/timing/lateness_ms", assembled.timing.lateness_ns * 1e-6)
        for stage, duration_ns in assembled.timing.stages_ns.items():
            columns.scalar(f"plots/timing/{stage}_ms", duration_ns * 1e-6)
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
