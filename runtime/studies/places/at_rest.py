"""A sensor that stands still while people walk: which landmarks stand on beams that move?"""

from pathlib import Path

import numpy as np

from drivers.measurements import FloatArray, Scan
from runtime.importers.sightings import seen
from runtime.importers.ticks import ticks
from runtime.importers.wheel_streams import samples_at_rest
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.recorded_drive import thinned
from runtime.studies.places.recorded_place import LEAVING_STREAM
from runtime.studies.places.recordings import archive_of
from slam.estimate import Estimate, Quality
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings

MODEL, WHEEL_PERIOD_NS = "differential", 20_000_000
BEFORE_NS = 500_000_000  # that the wheels have stood at the first scan
BESIDE_M = 0.3  # a trunk's centre lies that far behind its skin
STILL_SHARE = 0.5  # what stands is seen by a beam in half of the scans at least


def place_at_rest(
    data: str,
    name: str,
    left_out: float,
    seed: int,
    code: str,  # noqa: ARG001  names the job
    digest: str,  # noqa: ARG001  the same for the archive
) -> Result:
    """Landmarks of the map with the defaults and wheels that never turn.

    moving_share: of all landmarks that were ever in the map, those that stand where no beam sees anything standing.
    """
    archive = archive_of(Path(data), name)
    scans = [scan for scan in seen(archive) if isinstance(scan, Scan)]
    background = standing_points(scans)
    kept = list(thinned(scans, left_out, np.random.default_rng([seed, LEAVING_STREAM])))
    stamps = range(kept[0].stamp_ns - BEFORE_NS, kept[-1].stamp_ns + 1, WHEEL_PERIOD_NS)
    wheels = samples_at_rest(list(stamps), MODEL)
    estimator = Estimator(SlamSettings(), 1, map_every=1)
    ever: dict[int, FloatArray] = {}
    estimates: list[Estimate] = []
    for tick in ticks(kept, wheels, 5 * WHEEL_PERIOD_NS):
        estimate = estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        if (landmarks := estimate.landmarks) is not None:
            ever |= dict(zip(landmarks.identities.tolist(), landmarks.means_m, strict=True))
        estimates.append(estimate)
    moving = [np.hypot(*(background - place).T).min(initial=np.inf) > BESIDE_M for place in ever.values()]
    return {
        "scans": len(kept),
        "landmarks": int(estimates[-1].counts.get("landmarks", 0)),
        "landmarks_ever": len(ever),
        "moving_share": float(np.mean(moving)) if moving else 0.0,
        "lost": sum(estimate.quality is Quality.LOST for estimate in estimates) / len(estimates),
    }


def standing_points(scans: list[Scan]) -> FloatArray:
    """(n, 2) what stands, in the laser's frame: the median of each beam that returns in half of the scans."""
    ranges = np.array([scan.ranges_m for scan in scans], dtype=np.float64)
    kept = np.isfinite(ranges).mean(axis=0) >= STILL_SHARE
    middle, bearings = np.nanmedian(ranges[:, kept], axis=0), scans[0].bearings_rad[kept]
    near = (np.abs(ranges[:, kept] - middle) < BESIDE_M).mean(axis=0) >= STILL_SHARE
    points: FloatArray = np.column_stack((middle * np.cos(bearings), middle * np.sin(bearings)))[near]
    return points
