"""How well the loop kept its grid, in memory that does not grow with the run."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

BIN_NS = 10_000  # 0.01 ms: as fine as anyone reads it
BINS = 50_000  # up to 0.5 s; what takes longer counts as that, except in the largest


class Durations:
    """Percentiles of any number of durations, to 0.01 ms."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(BINS, np.int64)
        self._count = 0
        self.largest_ns = 0

    @classmethod
    def of(cls, durations_ms: NDArray[np.float64]) -> "Durations":
        """Those of a record, in which NaN is none: what is read in a review is what the run itself said."""
        durations, known_ns = cls(), np.rint(durations_ms[np.isfinite(durations_ms)] * 1e6).astype(np.int64)
        durations._counts = np.bincount(np.clip(known_ns // BIN_NS, 0, BINS - 1), minlength=BINS)
        durations._count, durations.largest_ns = len(known_ns), int(known_ns.max(initial=0))
        return durations

    def __len__(self) -> int:
        return self._count

    def add(self, duration_ns: int) -> None:
        """One more; what is below zero counts as zero."""
        self._counts[min(max(duration_ns, 0) // BIN_NS, BINS - 1)] += 1
        self._count += 1
        self.largest_ns = max(self.largest_ns, duration_ns)

    def percentile_ms(self, share: float) -> float:
        """The duration that this share (0 to 1) does not exceed; 0 without any."""
        if not self._count:
            return 0.0
        number = int(np.searchsorted(np.cumsum(self._counts), share * self._count))
        return min((number + 1) * BIN_NS, max(self.largest_ns, 0)) * 1e-6

    def spread(self) -> dict[str, float]:
        """p50, p99 and the largest, ms."""
        return {
            "p50": round(self.percentile_ms(0.5), 3),
            "p99": round(self.percentile_ms(0.99), 3),
            "max": round(self.largest_ns * 1e-6, 3),
        }


@dataclass(slots=True)
class Timekeeping:
    """Lateness is from the grid point to the wake-up, duration from there to the end of the tick.

    stages: of every tick, by name. overhead: what is not reading and stepping: handing on to record, network and log.
    """

    lateness: Durations = field(default_factory=Durations)
    duration: Durations = field(default_factory=Durations)
    overhead: Durations = field(default_factory=Durations)
    stages: dict[str, Durations] = field(default_factory=dict)
    ticks: int = 0
    missed: int = 0
    missed_before: int = 0
    first_beat_ns: int = 0
    last_beat_ns: int = 0

    def note(self, beat_ns: int, lateness_ns: int, missed: int, duration_ns: int) -> None:
        """One tick that has ended."""
        if not self.ticks:
            self.first_beat_ns, self.missed_before = beat_ns, missed
        self.last_beat_ns = beat_ns
        self.ticks += 1
        self.missed += missed
        self.lateness.add(lateness_ns)
        self.duration.add(duration_ns)

    def note_stages(self, durations_ns: dict[str, int], overhead_ns: int) -> None:
        """Its stages by name."""
        for name, duration_ns in durations_ns.items():
            if name not in self.stages:
                self.stages[name] = Durations()
            self.stages[name].add(duration_ns)
        self.overhead.add(overhead_ns)

    @property
    def rate_hz(self) -> float:
        """Ticks a second between the first and the last."""
        span_ns = self.last_beat_ns - self.first_beat_ns
        return (self.ticks - 1) * 1e9 / span_ns if span_ns > 0 else 0.0

    @property
    def beat_hz(self) -> float:
        """Beats a second, kept or missed: exact unless one went uncounted or the grid drifted."""
        span_ns = self.last_beat_ns - self.first_beat_ns
        return (self.ticks - 1 + self.missed - self.missed_before) * 1e9 / span_ns if span_ns > 0 else 0.0
