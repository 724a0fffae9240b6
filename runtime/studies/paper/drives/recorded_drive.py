"""The method on recordings of others: Victoria Park, MRCLAM with and without its identities, Intel's laboratory."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray, OdometryPose, ScanLike, Sightings
from runtime.importers.archive import Archive, load_archive
from runtime.importers.data_set import FAST_SPACING_NS, SLOW_SPACING_NS, configuration_path
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import wheel_samples
from runtime.settings.configuration import load_configuration
from runtime.settings.data_set import DataSetSettings
from runtime.source_tree import SHARED_DATA
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.arms import arm_settings, merged
from runtime.studies.paper.drives.recorded_errors import figures_against, shown_paths
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings

VICTORIA = "victoria_park"
CODED = ("mrclam_d6_r1", "mrclam_d6_r2", "mrclam_d6_r3")
INDOOR = "intel_lab"


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses of one drive as rows (n, 4) of t s, x m, y m, heading rad, under published, particles and odometry.

    covariances (n, 3, 3) of the published ones.
    """

    rows: dict[str, FloatArray]
    covariances: FloatArray


def is_there(data_set: str) -> bool:
    """Whether the recording lies beside the repository."""
    return (SHARED_DATA / data_set).is_dir()


def recorded_drive(
    data_set: str,
    seed: int,
    arm: str,
    particles: int,
    keep_paths: bool,
    code: str,  # noqa: ARG001  names the job
    withheld: bool = False,
    left_out: float = 0.0,
) -> Result:
    """Figures of one recording against its own truth; `code` as in feature_drive.

    withheld: the filter does not get the identities that the sensor reports. left_out: share of scans, or of
    sightings, that is left out at random: the published pose has no random part of its own, so this shows how much
    of it is luck.
    Raises FileNotFoundError where the recording is not there.
    """
    folder = SHARED_DATA / data_set
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is not there")
    archive = _archive(folder)
    changes = merged(arm_settings(arm), {"particles": particles})
    if withheld:
        changes = merged(changes, {"association": {"strategy": "sequential"}})
    configuration = load_configuration(configuration_path(archive))
    settings = SlamSettings.model_validate(merged(configuration.slam.model_dump(), changes))
    estimator = Estimator(settings, seed)
    stamps = configuration.data_set or DataSetSettings()
    archive = replace(archive, laser_latency_s=stamps.laser_latency_s)
    scans = thinned(seen(archive), left_out, np.random.default_rng([seed, 5]))
    wheels = wheel_samples(archive)
    spacing_ns = SLOW_SPACING_NS if isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    rows: dict[str, list[tuple[float, ...]]] = {"published": [], "particles": [], "odometry": []}
    covariances = []
    likelihoods = 0.0
    counts: dict[str, float] = {}
    map_m: FloatArray = np.empty((0, 2))
    began_s = time.process_time()
    for tick in ticks(without_identities(scans) if withheld else scans, wheels, spacing_ns):
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        poses = (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body)
        for name, pose in zip(rows, poses, strict=True):
            rows[name].append((tick.stamp_ns * 1e-9, pose.x_m, pose.y_m, pose.heading_rad))
        covariances.append(estimate.covariance)
        counts = dict(estimate.counts)
        likelihoods += counts.get("likelihoods", 0.0)
        if estimate.landmarks is not None:
            map_m = estimate.landmarks.means_m
    spent_s = time.process_time() - began_s
    truth = truth_of(archive)
    if truth is None:
        raise ValueError(f"{folder} has no truth")
    kept = Poses({name: np.array(column) for name, column in rows.items()}, np.array(covariances))
    body_from_laser = (settings.mount.x_m, settings.mount.y_m, settings.mount.yaw_rad)
    result: Result = {
        "landmarks": int(counts["landmarks"]),
        "likelihoods": likelihoods,
        "cpu_s": spent_s,
        "not_finite": int(counts["not_finite"]) + int(sum((~np.isfinite(path)).sum() for path in kept.rows.values())),
        **figures_against(truth, kept.rows, kept.covariances, body_from_laser),
    }
    return result | (shown_paths(truth, kept.rows, map_m, body_from_laser) if keep_paths else {})


def thinned(scans: Iterable[ScanLike], left_out: float, generator: np.random.Generator) -> Iterator[ScanLike]:
    """Without a random share of the scans, or of the sightings in them."""
    for scan in scans:
        if isinstance(scan, Sightings):
            kept = generator.random(len(scan.ranges_m)) >= left_out
            if kept.any():
                yield Sightings(scan.stamp_ns, scan.ranges_m[kept], scan.bearings_rad[kept], scan.identities[kept])
        elif generator.random() >= left_out:
            yield scan


def without_identities(scans: Iterable[ScanLike]) -> Iterator[ScanLike]:
    """Sightings as of a sensor that does not know what it saw."""
    for scan in scans:
        unknown: Any = np.full(len(scan.identities), -1, dtype=np.int64) if isinstance(scan, Sightings) else None
        yield scan if unknown is None else replace(scan, identities=unknown)


@lru_cache(maxsize=1)
def _archive(folder: Path) -> Archive:
    return load_archive(folder)
