"""Real second sessions: the map of one drive through a building, and another drive that begins in it without a pose."""

from pathlib import Path

import numpy as np

from drivers.measurements import FloatArray, OdometryPose
from runtime.evaluate.errors import position_error, rigid_fit
from runtime.evaluate.rows import poses_at
from runtime.importers.data_set import FAST_SPACING_NS, SLOW_SPACING_NS
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.settings.configuration import Configuration
from runtime.studies.jobs import Result
from runtime.studies.places.recordings import archive_of, prepared
from runtime.tick import Tick
from slam.estimator import Estimator
from slam.maps.start import MapStart
from slam.pose import composed

PARTICLES = 10


def session_trial(
    data: str,
    mapped: str,
    driven: str,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """driven_m until the place was recognised (None: never), and from then on the RMS against the reference of the
    second drive after a rigid fit, localisation only. searched: landmarks and odds of the best attempt.
    """
    ticks_of_map, configuration, _ = _drive(data, mapped)
    estimator = Estimator(configuration.slam, 1)
    for tick in ticks_of_map:
        estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
    known = estimator.joint_map()
    ticks_of_drive, configuration, truth = _drive(data, driven)
    estimator = Estimator(configuration.slam, 1, start=MapStart(known, True, None))
    rows: list[tuple[float, ...]] = []
    way_m, before, found_m, jumps = 0.0, np.zeros(2), None, 0
    best = (-np.inf, 0.0)
    for tick in ticks_of_drive:
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        at = estimate.odom_from_body.as_array()[:2]
        way_m, before = way_m + float(np.hypot(*(at - before))), at
        if estimate.recognition is not None and not estimate.recognition.is_new:
            jumps += 1
            found_m = way_m if found_m is None else found_m
        if found_m is None and "search_odds" in estimate.counts:
            best = max(best, (estimate.counts["search_odds"], estimate.counts["search_landmarks"]))
        if found_m is not None:
            rows.append((tick.stamp_ns * 1e-9, *estimate.map_from_body.as_array().tolist()))
    mount = configuration.slam.mount.as_pose().as_array()
    return {
        "map": mapped,
        "drive": driven,
        "landmarks": len(known),
        "way_m": round(way_m, 1),
        "driven_m": None if found_m is None else round(found_m, 1),
        "recognitions": jumps,
        "rms_m": None if found_m is None else _rms_m(np.array(rows), truth, mount),
        "best_odds": round(best[0], 1) if np.isfinite(best[0]) else None,
        "best_landmarks": int(best[1]),
    }


def _rms_m(path: FloatArray, truth: FloatArray, mount: FloatArray) -> float | None:
    points = composed(poses_at(path, truth[:, 0]), mount)[:, :2]
    known = np.isfinite(points[:, 0])
    if known.sum() < 3:
        return None
    places = truth[known, 1:3]
    return round(position_error(rigid_fit(points[known], places).transform(points[known]), places).rms_m, 4)


def _drive(data: str, name: str) -> tuple[list[Tick], Configuration, FloatArray]:
    archive, configuration = prepared(archive_of(Path(data), name), own=True)
    tree = configuration.slam.model_dump() | {"particles": PARTICLES}
    configuration = configuration.model_copy(update={"slam": type(configuration.slam).model_validate(tree)})
    wheels = wheel_samples(archive, configuration.vehicle)
    spacing_ns = SLOW_SPACING_NS if isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    truth = truth_of(archive)
    if truth is None or truth.poses is None:
        raise ValueError(f"{name} has no poses to compare with")
    return list(ticks(list(seen(archive)), wheels, spacing_ns)), configuration, truth.poses
