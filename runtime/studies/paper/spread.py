"""Figures over seeds with their spread: bootstrap intervals (Efron 1979, percentiles), paired by seed."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from drivers.measurements import FloatArray

DRAWS = 4000


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean with its 95 % interval, median with its own, the extremes, and how many seeds."""

    seeds: int
    mean: float
    mean_low: float
    mean_high: float
    median: float
    median_low: float
    median_high: float
    least: float
    most: float

    def row(self) -> dict[str, float]:
        """For a table."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Comparison:
    """One arm against another on the same seeds.

    ratio: mean over mean, with its 95 % interval; difference: mean of the paired differences, with its own.
    """

    seeds: int
    ratio: float
    ratio_low: float
    ratio_high: float
    difference: float
    difference_low: float
    difference_high: float

    def row(self) -> dict[str, float]:
        """For a table."""
        return asdict(self)


def spread(values: FloatArray) -> Spread:
    """Of one figure per seed, (n,)."""
    _check(values)
    mean_low, mean_high = interval(values[:, np.newaxis], lambda draws: draws[..., 0].mean(axis=1))
    median_low, median_high = interval(values[:, np.newaxis], lambda draws: np.median(draws[..., 0], axis=1))
    return Spread(
        len(values),
        float(values.mean()),
        mean_low,
        mean_high,
        float(np.median(values)),
        median_low,
        median_high,
        float(values.min()),
        float(values.max()),
    )


def compare(values: FloatArray, against: FloatArray) -> Comparison:
    """Both (n,), row by row the same seed."""
    if values.shape != against.shape:
        raise ValueError(f"{values.shape=} but {against.shape=}")
    _check(values)
    both = np.column_stack((values, against))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(values.mean() / against.mean())
        ratio_low, ratio_high = interval(both, lambda draws: draws[..., 0].mean(axis=1) / draws[..., 1].mean(axis=1))
    low, high = interval(both, lambda draws: (draws[..., 0] - draws[..., 1]).mean(axis=1))
    return Comparison(len(values), ratio, ratio_low, ratio_high, float((values - against).mean()), low, high)


def interval(rows: FloatArray, statistic: Callable[[FloatArray], FloatArray]) -> tuple[float, float]:
    """95 % bootstrap interval of a statistic of rows (n, k) drawn again with replacement; seeded, so repeatable."""
    picks = np.random.default_rng(0).integers(0, len(rows), (DRAWS, len(rows)))
    low, high = np.percentile(statistic(rows[picks]), (2.5, 97.5))
    return float(low), float(high)


def _check(values: FloatArray) -> None:
    if values.ndim != 1 or len(values) == 0:
        raise ValueError(f"{values.shape=}, expected one figure per seed")
