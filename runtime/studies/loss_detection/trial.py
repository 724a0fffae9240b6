"""One simulated drive with the filter's own doubts about it, and what other bounds would have said of it."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import DriveSettings, WorldSettings
from runtime.studies.jobs import Result
from runtime.studies.loss_detection.drives import MishapKind, draw_mishap, simulated_ticks
from slam.estimate import Estimate, Quality
from slam.estimator import Estimator
from slam.joint.evidence import Evidence
from slam.pose import wrap_rad
from slam.quality import LOST_GROWTH, QualityMonitor, largest_deviation_m
from slam.settings.quality import QualitySettings
from slam.settings.slam import SlamSettings

WATCHED_S = 6.0  # of a drive after a mishap
PLACES: Mapping[str, Mapping[str, Any]] = {
    "park": {},
    "crowd": {"people": 20},
    "open": {"poles": 5, "trees": 5, "walls": 1, "bushes": 4, "people": 14},
    "large": {
        "poles": 36,
        "trees": 42,
        "bushes": 20,
        "walls": 6,
        "people": 14,
        "drive": DriveSettings(course_scale=3.0),
    },
}
COLUMNS = (
    *("stamp_s", "has_scan", "known", "found", "missed", "square", "sigma_m", "gap_m", "error_m", "error_rad"),
    *("against", "seen_before_share"),
)


def place(name: str, seed: int) -> WorldSettings:
    """One of the places: a park, a crowd in it, an open field with few things and many people, a larger park."""
    return WorldSettings(seed=seed, **PLACES[name])


def trial(
    seed: int,
    where: str,
    kind: str,
    duration_s: float,
    particles: int,
    quality: Mapping[str, Any],
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """One drive. kind: what happens to it, "" for nothing; then it lasts duration_s.

    Result: at_s of the mishap (None without), states: pairs of time and quality at each change, trace: COLUMNS a tick.
    """
    world = place(where, seed)
    mishap = draw_mishap(MishapKind(kind), world) if kind else None
    mount = world.laser.body_from_laser
    settings = SlamSettings.model_validate(
        {
            "particles": particles,
            "mount": {"x_m": mount[0]},
            "quality": quality,
        }
    )
    estimator = Estimator(settings, seed, map_every=1000)
    trace: list[list[float]] = []
    states: list[tuple[float, str, str]] = []
    for tick in simulated_ticks(world, duration_s if mishap is None else mishap.at_s + WATCHED_S, mishap):
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        pose, truth, counts, stamp_s = estimate.map_from_body, tick.truth, estimate.counts, tick.stamp_ns * 1e-9
        if not states or states[-1][1] != estimate.quality.value:
            states.append((stamp_s, estimate.quality.value, estimate.doubt))
        trace.append(
            [
                round(stamp_s, 4),
                float(tick.scan is not None),
                *(counts.get(name, 0.0) for name in ("known_in_view", "known_found", "known_missed")),
                round(counts.get("known_square", 0.0), 3),
                round(largest_deviation_m(own_covariance(estimate)), 4),
                round(math.dist((pose.x_m, pose.y_m), (estimate.particle_mean.x_m, estimate.particle_mean.y_m)), 4),
                round(math.dist((pose.x_m, pose.y_m), truth[:2]), 4),
                round(wrap_rad(pose.heading_rad - float(truth[2])), 5),
                round(counts.get("known_against", 0.0), 3),
                round(counts.get("seen_before_share", -1.0), 3),
            ]
        )
    return {
        "seed": seed,
        "where": where,
        "kind": kind,
        "at_s": None if mishap is None else mishap.at_s,
        "states": states,
        "trace": trace,
    }


def own_covariance(estimate: Estimate) -> FloatArray:
    """What the filter itself believes, (3, 3): while lost more is published than that."""
    lost = estimate.quality is Quality.LOST
    return estimate.covariance - LOST_GROWTH if lost else estimate.covariance


def judged_again(trace: FloatArray, settings: QualitySettings) -> Iterator[Quality]:
    """What the monitor says, tick by tick, of a recorded trace (n, COLUMNS) with other bounds.

    Which landmarks count as settled, and when the map is held, stay as they were in the drive.
    """
    monitor = QualityMonitor(settings)
    for row in trace:
        stamp_ns = round(row[0] * 1e9)
        if row[1]:
            evidence = Evidence(int(row[2]), int(row[3]), int(row[4]), float(row[10]), float(row[5]))
            monitor.add(stamp_ns, evidence, None if row[11] < 0.0 else float(row[11]))
        covariance = np.diag((row[6] ** 2, row[6] ** 2, 0.0))
        yield monitor.judge(stamp_ns, covariance, float(row[7])).quality
