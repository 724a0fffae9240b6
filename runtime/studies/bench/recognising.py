"""How long it takes to look for a rover in maps of all sizes, and the longest slice of it that the loop waits for."""

import time
from collections.abc import Iterator

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.bench.figure import BenchFigure, spread
from slam.pose import Pose2
from slam.recognise.attempt import Attempt, LocalPoints
from slam.recognise.map_index import IndexedMap, index_of
from slam.recognise.scale import Scale

SIZES = (200, 1000, 5000, 20_000)  # landmarks
DENSITY_PER_M2 = 0.004  # as in a park
SEEN, SEEN_SIGMA_M = 28, 0.05  # landmarks around the rover
MARGIN_M = 30.0
PLACES = 12
SCALE = Scale(0.1)


def recognising() -> Iterator[BenchFigure]:
    """For each size of a map: CPU time of a whole attempt, and of one slice of it, ms."""
    for size in SIZES:
        rng = np.random.default_rng(size)
        means_m, index = park_map(size, rng)
        spent = [slices_ms(index, points_around(means_m, rng)) for _ in range(PLACES)]
        yield BenchFigure(f"recognise_n{size}", *spread(np.array([sum(slices) for slices in spent])))
        yield BenchFigure(f"recognise_slice_n{size}", *spread(np.concatenate(spent)))


def park_map(size: int, rng: np.random.Generator) -> tuple[FloatArray, IndexedMap]:
    """So many landmarks (size, 2) anywhere on a square, and their index."""
    means_m = rng.uniform(0.0, np.sqrt(size / DENSITY_PER_M2), (size, 2))
    return means_m, index_of(SCALE, np.arange(size), means_m).indexed


def points_around(means_m: FloatArray, rng: np.random.Generator) -> LocalPoints:
    """The landmarks around some place, as a rover there sees them."""
    x_m, y_m = rng.uniform(MARGIN_M, means_m.max() - MARGIN_M, 2).tolist()
    place = Pose2(x_m, y_m, float(rng.uniform(-np.pi, np.pi)))
    near = np.argsort(np.hypot(*(means_m - (x_m, y_m)).T), kind="stable")[:SEEN]
    seen_m = place.inverse().transform(means_m[near]) + rng.normal(0.0, SEEN_SIGMA_M, (SEEN, 2))
    return LocalPoints(near, seen_m, SEEN_SIGMA_M**2 * np.eye(2 * SEEN), np.full(SEEN, 3.0))


def slices_ms(index: IndexedMap, points: LocalPoints) -> list[float]:
    """CPU time of each slice of an attempt. Raises ValueError where the place is not found: that was no attempt."""
    attempt, spent, found = Attempt(SCALE, index, points), [], None
    while found is None:
        began_ns = time.thread_time_ns()
        found = attempt.advance()
        spent.append((time.thread_time_ns() - began_ns) * 1e-6)
    if not found.acceptable:
        raise ValueError(f"{len(points)} landmarks were not recognised, odds {found.odds:.1f}")
    return spent
