"""An estimator driven through ticks: what it published, tick by tick."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.fault_isolation import step_or_predict
from runtime.tick import Tick
from slam.estimate import Quality
from slam.estimator import Estimator


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """Published poses and odometry, rows (n, 4) of t s, x m, y m, heading rad; qualities (n,) as words.

    sigma_m (n,): root of the trace of the published covariance of the position. maps (n,): number of the map that each
    pose is in. step_s (n,): CPU time of each step.
    landmarks: in the map at the end. defects: steps that failed and became predictions.
    """

    published: FloatArray
    odometry: FloatArray
    sigma_m: FloatArray
    maps: FloatArray
    qualities: tuple[Quality, ...]
    step_s: FloatArray
    landmarks: int
    defects: int

    def share_of(self, quality: Quality) -> float:
        """Share of the ticks with this quality."""
        return sum(said is quality for said in self.qualities) / len(self.qualities)


def driven(estimator: Estimator, ticks: Iterable[Tick]) -> Driven:
    """Step the estimator over all ticks. Raises ValueError where there are none."""
    published, odometry, sigma_m, maps, qualities, step_s = [], [], [], [], [], []
    landmarks, defects, map_id = 0, 0, 0.0
    for tick in ticks:
        began_s = time.process_time()
        estimate, events = step_or_predict(estimator, tick)
        step_s.append(time.process_time() - began_s)
        seconds, covariance = estimate.stamp_ns * 1e-9, estimate.covariance
        published.append((seconds, *estimate.map_from_body.as_array()))
        odometry.append((seconds, *estimate.odom_from_body.as_array()))
        sigma_m.append(float(np.sqrt(max(covariance[0, 0] + covariance[1, 1], 0.0))))
        map_id = estimate.counts.get("map_id", map_id)
        maps.append(map_id)
        qualities.append(estimate.quality)
        defects += len(events)
        landmarks = int(estimate.counts.get("landmarks", landmarks))
    if not published:
        raise ValueError("a drive without ticks: expected one at least")
    return Driven(
        np.array(published),
        np.array(odometry),
        np.array(sigma_m),
        np.array(maps),
        tuple(qualities),
        np.array(step_s),
        landmarks,
        defects,
    )
