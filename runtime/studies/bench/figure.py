"""One measured figure, as `infant bench` prints it."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray


@dataclass(frozen=True, slots=True)
class BenchFigure:
    """The median, and its 99th percentile where there is a spread."""

    name: str
    value: float
    unit: str
    p99: float | None = None


def spread(times_ms: FloatArray) -> tuple[float, str, float]:
    """Median, unit, 99th percentile."""
    return round(float(np.median(times_ms)), 4), "ms", round(float(np.percentile(times_ms, 99)), 4)
