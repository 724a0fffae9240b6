"""One measured figure, as `infant bench` prints it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BenchFigure:
    """The median, and its 99th percentile where there is a spread."""

    name: str
    value: float
    unit: str
    p99: float | None = None
