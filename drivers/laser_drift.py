"""Drift of a clock from the delays of its messages: slope of the lower hull, and of the means.

The lower hull is the linear programme of Moon, Skelly and Towsley (1999): the line below all delays that is nearest
to them. A point is (device time in ns, arrival minus device time in ns).
"""

import math
from collections.abc import Sequence
from itertools import pairwise

HALF_MS_NS = 500_000  # a counter of milliseconds is on average half a millisecond behind


class BucketMean:
    """Running mean of the points of a bucket, and the scatter around it (Welford)."""

    def __init__(self, x: float, y: float) -> None:
        self.x, self.y = float(x), float(y)
        self._count = 1
        self._squares = 0.0

    def add(self, x: float, y: float) -> None:
        """One more point."""
        self._count += 1
        before = y - self.y
        self.x += (x - self.x) / self._count
        self.y += before / self._count
        self._squares += before * (y - self.y)

    @property
    def variance_of_mean(self) -> float:
        """Square of the standard error."""
        return self._squares / max(1, self._count - 1) / self._count


def weigh(value: float, sigma: float, other: float, other_sigma: float) -> tuple[float, float]:
    """Two estimates of one thing, by their variances."""
    weight = sigma**2 / (sigma**2 + other_sigma**2)
    return value + weight * (other - value), other_sigma * math.sqrt(weight)


def mean_slope(means: Sequence[BucketMean]) -> tuple[float, float]:
    """Least squares through the means of the buckets; the deviation of the slope follows from the scatter inside."""
    count = len(means)
    middle_x, middle_y = sum(mean.x for mean in means) / count, sum(mean.y for mean in means) / count
    spread = sum((mean.x - middle_x) ** 2 for mean in means)
    slope = sum((mean.x - middle_x) * (mean.y - middle_y) for mean in means) / spread
    variance = sum(mean.variance_of_mean for mean in means) / count
    residual = sum((mean.y - middle_y - slope * (mean.x - middle_x)) ** 2 for mean in means) / (count - 2)
    return slope, math.sqrt(max(variance, residual) / spread)


def hull_slope(points: Sequence[tuple[int, int]]) -> tuple[float, float, float]:
    """Slope of the edge of the lower convex hull above the mean abscissa, its deviation, and the points' scatter."""
    hull: list[tuple[int, int]] = []
    for x, y in points:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2], hull[-1]
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    middle = sum(x for x, _ in points) / len(points)
    (x0, y0), (x1, y1) = next(edge for edge in pairwise(hull) if edge[1][0] >= middle)
    slope = (y1 - y0) / (x1 - x0)
    residuals = sorted(y - slope * x for x, y in points)
    scatter_ns = residuals[len(residuals) // 2] - residuals[0] + HALF_MS_NS / 2
    return slope, scatter_ns / (points[-1][0] - points[0][0]), scatter_ns
