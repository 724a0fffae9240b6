"""What a run was like in a dozen figures: printed at its end and kept as summary.json."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.measurements import SensorHealth
from runtime.loop import Timekeeping
from runtime.sensor_report import sensor_lines, sensor_object
from runtime.tick import SinkHealth, Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2


@dataclass(slots=True)
class ErrorTrack:
    """Sink that compares the pose and plain odometry with the simulator's truth, in the frame of the start pose."""

    slam_m2: list[float] = field(default_factory=list)
    odometry_m2: list[float] = field(default_factory=list)
    last: Estimate | None = None
    landmarks: int = 0

    def put(
        self,
        tick: Tick,  # noqa: ARG002
        estimate: Estimate,
        timing: Timing,  # noqa: ARG002
        state_hash: bytes,  # noqa: ARG002
        truth: Pose2 | None,
    ) -> None:
        """One tick."""
        self.last = estimate
        self.landmarks = int(estimate.counts.get("landmarks", self.landmarks))
        if truth is not None:
            self.slam_m2.append(_distance_m2(estimate.map_from_body, truth))
            self.odometry_m2.append(_distance_m2(estimate.odom_from_body, truth))

    def health(self) -> SinkHealth:
        """Keeps figures in memory only: never in trouble."""
        return SinkHealth(0, 0)

    def close(self) -> None:
        """Nothing to release."""


def summarise(
    run: str, timekeeping: Timekeeping, errors: ErrorTrack, sensors: Mapping[str, SensorHealth]
) -> dict[str, Any]:
    """The summary of a live run; figures that do not exist are None. sensors: how they were at its end."""
    lateness_ms = np.array(timekeeping.lateness_ns or [0]) * 1e-6
    step_ms = np.array(timekeeping.duration_ns or [0]) * 1e-6
    return {
        "run": run,
        "ticks": len(timekeeping.lateness_ns),
        "missed": timekeeping.missed,
        "rate_hz": round(timekeeping.rate_hz, 4),
        "lateness_ms": _spread(lateness_ms),
        "tick_ms": _spread(step_ms),
        "odometry_rms_m": _rms(errors.odometry_m2),
        "slam_rms_m": _rms(errors.slam_m2),
        "slam_max_m": round(math.sqrt(max(errors.slam_m2)), 4) if errors.slam_m2 else None,
        "landmarks": errors.landmarks,
        "sensors": {name: sensor_object(sensor) for name, sensor in sensors.items()},
    }


def summary_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    late, tick = summary["lateness_ms"], summary["tick_ms"]
    lines = [
        f"ticks     {summary['ticks']} at {summary['rate_hz']:.2f} Hz, {summary['missed']} missed",
        f"lateness  p50 {late['p50']:.2f}  p99 {late['p99']:.2f}  max {late['max']:.2f} ms",
        f"tick      p50 {tick['p50']:.2f}  p99 {tick['p99']:.2f}  max {tick['max']:.2f} ms",
        f"landmarks {summary['landmarks']}",
        *sensor_lines(summary["sensors"]),
    ]
    if summary["slam_rms_m"] is not None:
        lines.append(
            f"error     odometry alone {summary['odometry_rms_m']:.3f} m, SLAM {summary['slam_rms_m']:.3f} m "
            f"(RMS against the simulator's truth; SLAM at most {summary['slam_max_m']:.3f} m)"
        )
    lines.append(f"run       {summary['run']}")
    return lines


def _distance_m2(estimate: Pose2, truth: Pose2) -> float:
    return (estimate.x_m - truth.x_m) ** 2 + (estimate.y_m - truth.y_m) ** 2


def _rms(squares_m2: list[float]) -> float | None:
    return round(math.sqrt(sum(squares_m2) / len(squares_m2)), 4) if squares_m2 else None


def _spread(values: "np.ndarray[Any, np.dtype[np.float64]]") -> dict[str, float]:
    p50, p99 = np.percentile(values, (50, 99))
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(float(values.max()), 3)}
