"""Condition a Gaussian on matches that are jointly compatible; the worst are dropped until the rest are."""

import math
from collections.abc import Callable

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.elementary import squared
from slam.arithmetic.small_matrices import applied, inner, inverse, product, squared_distance

ITERATIONS = 3
DROPPED_SHARE = 3  # at most one match in so many
NORMAL_999 = 3.090  # quantile of the standard normal distribution

Evaluate = Callable[[FloatArray, list[int]], tuple[FloatArray, FloatArray]]


class Conditioned:
    """mean (N,), covariance (N, N) given the matches that were kept, and their squared distance with its freedom."""

    def __init__(self, mean: FloatArray, covariance: FloatArray, kept: list[int], square: float, freedom: int) -> None:
        self.mean, self.covariance = mean, covariance
        self.kept, self.square, self.freedom = kept, square, freedom


def chi_square_999(freedom: int) -> float:
    """What 99.9 % of squared distances stay below (Wilson and Hilferty)."""
    part = 2.0 / (9.0 * freedom)
    root = 1.0 - part + NORMAL_999 * math.sqrt(part)
    return freedom * root * root * root


def condition_on_matches(
    mean: FloatArray,
    covariance: FloatArray,
    evaluate: Evaluate,
    matches: int,
    sigma_m: float,
    unknown: int,
    least: int,
) -> Conditioned | None:
    """Iterated extended Kalman filter over gaps of two coordinates that are zero, up to sigma_m.

    evaluate(mean, kept): gaps (2 k,) and their derivatives (2 k, N) of the kept matches. unknown: coordinates that the
    prior leaves open, which the matches must pay for. None where fewer than `least` matches are compatible.
    """
    kept, most_dropped = list(range(matches)), matches // DROPPED_SHARE
    while len(kept) >= least:
        at = mean
        for _ in range(ITERATIONS):
            gaps, slopes = evaluate(at, kept)
            innovation = -gaps - applied(slopes, mean - at)
            projected = product(slopes, covariance)
            certainty = inverse(product(projected, slopes.T) + squared(sigma_m) * np.eye(len(gaps)))
            weighted = applied(certainty, innovation)
            at = mean + applied(projected.T, weighted)
        square, freedom = inner(innovation, weighted), 2 * len(kept) - unknown
        if square <= chi_square_999(freedom):
            posterior = covariance - product(product(projected.T, certainty), projected)
            return Conditioned(at, 0.5 * (posterior + posterior.T), kept, square, freedom)
        if matches - len(kept) == most_dropped:
            return None
        # what the squared distance would lose without each match
        losses = [
            squared_distance(weighted[two], certainty[two, two])
            for two in (slice(2 * index, 2 * index + 2) for index in range(len(kept)))
        ]
        del kept[int(np.argmax(losses))]
    return None
