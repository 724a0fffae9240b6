"""What a laser makes of true distances: mixed returns at edges, noise, beams that come back empty."""

import numpy as np

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import LaserGeometrySettings

MIXED_JUMP_M = 0.3
LEAST_RANGE_M = 0.02


def as_measured(distances_m: FloatArray, laser: LaserGeometrySettings, rng: np.random.Generator) -> FloatArray:
    """Ranges (n,) of a sweep with these true distances; inf in both: nothing came back."""
    hit = np.isfinite(distances_m)
    ranges = _mixed(distances_m, rng, laser.mixed_share)
    ranges = ranges + laser.sigma_range_m * rng.standard_normal(ranges.shape)
    lost = (rng.random(ranges.shape) < laser.drop_out_share) | (ranges > laser.range_max_m) | ~hit
    ranges[lost] = np.inf
    return np.maximum(ranges, LEAST_RANGE_M)


def _mixed(ranges: FloatArray, rng: np.random.Generator, share: float) -> FloatArray:
    """The laser's spot is wider than a ray: on the edge of a thing it falls on what is behind as well."""
    mixed = ranges.copy()
    draws, parts = rng.random(ranges.shape), rng.random(ranges.shape)
    for neighbour in (np.roll(ranges, 1), np.roll(ranges, -1)):
        with np.errstate(invalid="ignore"):
            edge = np.isfinite(neighbour) & (neighbour - ranges > MIXED_JUMP_M) & (draws < share)
        mixed[edge] = ranges[edge] + parts[edge] * (neighbour[edge] - ranges[edge])
    mixed[0], mixed[-1] = ranges[0], ranges[-1]
    return mixed
