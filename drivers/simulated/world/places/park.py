"""What stands still in the park: drawn once from the seed, clear of the course and of each other."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.course import Course

APART_M = 1.2
BLOBS_PER_BUSH = 5


@dataclass(frozen=True, slots=True, eq=False)
class Park:
    """Posts and trunks (l, 2) of radii (l,), poles first; blobs of bushes (b, 2), (b,); walls (w, 2) to (w, 2)."""

    landmarks_m: FloatArray
    radii_m: FloatArray
    poles: int
    blobs_m: FloatArray
    blob_radii_m: FloatArray
    wall_starts_m: FloatArray
    wall_ends_m: FloatArray


def plant(settings: WorldSettings, course: Course, rng: np.random.Generator) -> Park:
    """Draw a park; where it is too full for the numbers asked for, as many as have found a place."""
    path = course.points_m(np.arange(0.0, course.length_m, 0.1))
    low, high = path.min(axis=0) - settings.margin_m, path.max(axis=0) + settings.margin_m
    taken: list[tuple[float, float, float]] = []

    def place(radius: float, inset: float = 0.0) -> FloatArray | None:
        for _ in range(200):
            point: FloatArray = rng.uniform(low + inset, high - inset)
            if np.min(np.hypot(*(path - point).T)) < settings.clearance_m + radius:
                continue
            if all(np.hypot(point[0] - x, point[1] - y) > radius + other + APART_M for x, y, other in taken):
                taken.append((float(point[0]), float(point[1]), radius))
                return point
        return None

    starts, ends = [], []
    for _ in range(settings.walls):
        half, bearing = rng.uniform(1.5, 4.0), rng.uniform(-np.pi, np.pi)
        if (middle := place(half)) is not None:
            reach = half * np.array((np.cos(bearing), np.sin(bearing)))
            starts.append(middle - reach)
            ends.append(middle + reach)
    points, radii, poles = [], [], 0
    for low_m, high_m, count in ((0.03, 0.08, settings.poles), (0.10, 0.35, settings.trees)):
        for radius in rng.uniform(low_m, high_m, count):
            if (point := place(radius)) is not None:
                points.append(point)
                radii.append(radius)
                poles += high_m < 0.1
    blobs, blob_radii = [], []
    for size in rng.uniform(0.4, 1.1, settings.bushes):
        if (point := place(size)) is not None:
            blobs.append(point + 0.5 * size * rng.uniform(-1.0, 1.0, (BLOBS_PER_BUSH, 2)))
            blob_radii.append(size * rng.uniform(0.3, 0.6, BLOBS_PER_BUSH))
    return Park(
        np.reshape(points, (-1, 2)),
        np.array(radii),
        poles,
        np.reshape(blobs, (-1, 2)),
        np.reshape(blob_radii, -1),
        np.reshape(starts, (-1, 2)),
        np.reshape(ends, (-1, 2)),
    )
