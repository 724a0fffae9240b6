"""Drift of a clock from the delays of its messages: how far the fastest messages at both ends of a time lie apart.

Messages that met no delay on their way tell of the clock (Moon, Skelly, Towsley 1999), so a line is laid through the
fastest few of the first and of the last third (Paxson 1998 takes minima of segments for the same reason). In simulated
jitter (uniform, exponential, normal; 10 to 400 s) this had half of the error of the edge of the lower convex hull.
A point is (device time in ns, arrival minus device time in ns).
"""

import math
from collections.abc import Sequence
from heapq import nsmallest

HALF_MS_NS = 500_000  # a counter of milliseconds is on average half a millisecond behind
FASTEST = 5  # of each end; fewer say little of their own scatter
FASTEST_SHARE = 8  # of the points of an end one in so many, where there are more
POINTS_MIN = 3 * FASTEST
MEAN_OVER_SPREAD = 0.65  # deviation of the mean of the five fastest over their spread; above what simulations gave
SPREAD_MIN_NS = 100_000.0  # five messages that are equal by chance prove nothing


def weigh(value: float, sigma: float, other: float, other_sigma: float) -> tuple[float, float]:
    """Two estimates of one thing, by their variances."""
    weight = sigma**2 / (sigma**2 + other_sigma**2)
    return value + weight * (other - value), other_sigma * math.sqrt(weight)


def fastest_slope(points: Sequence[tuple[int, int]], near: float) -> tuple[float, float, float]:
    """Slope of the line through the fastest of both ends, its deviation, and the deviation of one end in ns.

    At least POINTS_MIN points, in the order of time. near: a slope from before, against which "fastest" is judged.
    """
    third = len(points) // 3
    count = max(FASTEST, third // FASTEST_SHARE)
    x0, y0 = points[0]
    ends = []
    for end in (points[:third], points[-third:]):
        middle = sum(x - x0 for x, _ in end) / third
        ends.append((middle, nsmallest(count, (y - y0 - near * (x - x0) for x, y in end))))
    (first_x, first), (last_x, last) = ends
    spread_ns = max(SPREAD_MIN_NS, (first[-1] - first[0] + last[-1] - last[0]) / 2.0)
    end_ns = MEAN_OVER_SPREAD * spread_ns * math.sqrt(FASTEST / count)
    slope = near + (sum(last) - sum(first)) / count / (last_x - first_x)
    return slope, math.sqrt(2.0) * end_ns / (last_x - first_x), end_ns


def slowest_slope(points: Sequence[tuple[int, int]], near: float) -> tuple[float, float]:
    """The same through the slowest: worth as much where jitter has a sharp upper bound, and little elsewhere."""
    slope, sigma, _ = fastest_slope([(x, -y) for x, y in points], -near)
    return -slope, sigma
