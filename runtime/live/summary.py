"""What a run was like in a dozen figures: printed at its end and kept as summary.json."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.measurements import SensorHealth
from runtime.live.timekeeping import Timekeeping
from runtime.map_files.end import end_lines
from runtime.record.trajectories import SEARCHING
from runtime.sensor_report import sensor_lines, sensor_object
from runtime.service.memory import resident_mb
from runtime.tick import CompletedTick, SinkHealth
from slam.estimate import Estimate
from slam.pose import Pose2


@dataclass(slots=True)
class SquaredErrors:
    """Sum, number and largest of squared distances; memory does not grow with the run."""

    sum_m2: float = 0.0
    largest_m2: float = 0.0
    count: int = 0

    def add(self, estimate: Pose2, truth: Pose2) -> None:
        """One tick."""
        square_m2 = (estimate.x_m - truth.x_m) ** 2 + (estimate.y_m - truth.y_m) ** 2
        self.sum_m2 += square_m2
        self.largest_m2 = max(self.largest_m2, square_m2)
        self.count += 1

    @property
    def rms_m(self) -> float | None:
        """None without any."""
        return math.sqrt(self.sum_m2 / self.count) if self.count else None

    @property
    def largest_m(self) -> float | None:
        """None without any."""
        return math.sqrt(self.largest_m2) if self.count else None


@dataclass(slots=True)
class ErrorTrack:
    """Sink that compares the pose and plain odometry with the simulator's truth, in the frame of the start pose.

    Poses before the place in a saved map was known count only where it never was, as in `infant evaluate`.
    """

    slam: SquaredErrors = field(default_factory=SquaredErrors)
    odometry: SquaredErrors = field(default_factory=SquaredErrors)
    last: Estimate | None = None
    landmarks: int = 0
    scans: int = 0
    wheel_samples: int = 0
    is_searching: bool | None = None  # until the place in the saved map is known; None before the first tick says

    def put(self, completed: CompletedTick) -> None:
        """One tick."""
        estimate, truth = completed.estimate, completed.truth
        self.last = estimate
        self.scans += completed.tick.scan is not None
        self.wheel_samples += sum(getattr(sample, "valid", True) for sample in completed.tick.wheels)
        self.landmarks = int(estimate.counts.get("landmarks", self.landmarks))
        known, is_new = (estimate.counts.get(name) for name in SEARCHING)
        if self.is_searching is None and known is not None:
            self.is_searching = known >= 2.0
        if self.is_searching and is_new == 0.0:
            self.slam, self.odometry, self.is_searching = SquaredErrors(), SquaredErrors(), False
        if truth is not None:
            self.slam.add(estimate.map_from_body, truth)
            self.odometry.add(estimate.odom_from_body, truth)

    def health(self) -> SinkHealth:
        """Keeps figures in memory only: never in trouble."""
        return SinkHealth(0, 0)

    def close(self) -> None:
        """Nothing to release."""


def summarise(
    run: str, timekeeping: Timekeeping, errors: ErrorTrack, sensors: Mapping[str, SensorHealth]
) -> dict[str, Any]:
    """The summary of a live run; figures that do not exist are None. sensors: how they were at its end."""
    return {
        "run": run,
        "ticks": timekeeping.ticks,
        "missed": timekeeping.missed,
        "scans": errors.scans,
        "wheel_samples": errors.wheel_samples,
        "rate_hz": round(timekeeping.rate_hz, 4),
        "beat_hz": round(timekeeping.beat_hz, 6),
        "lateness_ms": timekeeping.lateness.spread(),
        "tick_ms": timekeeping.duration.spread(),
        "overhead_ms": timekeeping.overhead.spread(),
        "stages_ms": {name: durations.spread() for name, durations in timekeeping.stages.items()},
        "odometry_rms_m": errors.odometry.rms_m,
        "slam_rms_m": errors.slam.rms_m,
        "slam_max_m": errors.slam.largest_m,
        "landmarks": errors.landmarks,
        "resident_mb": round(resident_mb(), 1),
        "sensors": {name: sensor_object(sensor) for name, sensor in sensors.items()},
    }


def summary_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    late, tick, over = summary["lateness_ms"], summary["tick_ms"], summary["overhead_ms"]
    lines = [
        f"ticks     {summary['ticks']} at {summary['rate_hz']:.2f} Hz, {summary['missed']} missed",
        f"lateness  p50 {late['p50']:.2f}  p99 {late['p99']:.2f}  max {late['max']:.2f} ms",
        f"tick      p50 {tick['p50']:.2f}  p99 {tick['p99']:.2f}  max {tick['max']:.2f} ms",
        f"overhead  p50 {over['p50']:.2f}  p99 {over['p99']:.2f}  max {over['max']:.2f} ms (record, network, log)",
        f"landmarks {summary['landmarks']}",
        f"memory    {summary['resident_mb']:.0f} MB resident",
        *sensor_lines(summary["sensors"]),
    ]
    if summary["slam_rms_m"] is not None:
        lines.append(
            f"error     odometry alone {summary['odometry_rms_m']:.3f} m, SLAM {summary['slam_rms_m']:.3f} m "
            f"(RMS against the simulator's truth; SLAM at most {summary['slam_max_m']:.3f} m)"
        )
    lines += end_lines(summary["map"]) if "map" in summary else []
    lines.append(f"run       {summary['run']}")
    return [*lines, f"next      infant review {summary['run']}"]


def silence(summary: dict[str, Any], config: str) -> str:
    """One sentence where neither sensor sent anything usable in the whole run, else ""."""
    if summary["scans"] or summary["wheel_samples"]:
        return ""
    return f"no sensor sent anything during the whole run; 'infant check --config {config} --live' shows what is wrong"
