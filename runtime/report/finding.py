"""What a review says about a run: one finding with its evidence, its likely cause and what to change."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import Event, Severity

Interval = tuple[float, float]
LATE_S, SHORT_S = 120.0, 10.0  # before and below which a span shows tenths of a second
RANKS = {Severity.INFO: 0, Severity.WARN: 1, Severity.ERROR: 2}


@dataclass(frozen=True, slots=True)
class Finding:
    """kind: a short stable word; title: one sentence with the figures; evidence: what was measured;
    cause: the most likely one; remedy: the configuration line or the thing to do; intervals: s since the first tick;
    follows: kind of the finding that this one is a consequence of, "" where it stands for itself.
    """

    kind: str
    severity: Severity
    title: str
    evidence: tuple[str, ...]
    cause: str
    remedy: str
    intervals: tuple[Interval, ...] = ()
    follows: str = ""

    def as_json(self) -> dict[str, Any]:
        """For report.json."""
        return asdict(self)


def worst(findings: Sequence[Finding]) -> Severity:
    """The highest severity; info where there are none."""
    return max((finding.severity for finding in findings), key=RANKS.__getitem__, default=Severity.INFO)


def span_text(interval: Interval) -> str:
    """12.1-13.4 s, or 190-260 s where it is late and long, as the plots, the events and `infant view --at` count."""
    start, end = interval
    if end >= LATE_S and end - start >= SHORT_S:
        return f"{start:.0f}-{end:.0f} s"
    first, last = f"{start:.1f}", f"{end:.1f}"
    return f"{first} s" if first == last else f"{first}-{last} s"


def spans_text(intervals: Sequence[Interval], most: int = 4) -> str:
    """The first few of them."""
    text = ", ".join(span_text(interval) for interval in intervals[:most])
    return f"{text} and {len(intervals) - most} more" if len(intervals) > most else text


def times_text(times_s: Sequence[float], most: int = 4) -> str:
    """The first few of them: 12.1 s, 13.4 s and 2 more."""
    text = ", ".join(f"{time_s:.1f} s" for time_s in times_s[:most])
    return f"{text} and {len(times_s) - most} more" if len(times_s) > most else text


def driver_reports(events: Sequence[Event], most: int = 3) -> tuple[str, ...]:
    """What the driver itself said, as evidence."""
    return tuple(f"driver: {event.reason}" for event in events[:most])


def intervals_where(
    times_s: NDArray[np.float64], holds: NDArray[np.bool_], joined_s: float, least_s: float = 0.0
) -> tuple[Interval, ...]:
    """Stretches of time where something holds; those nearer than joined_s are one, those below least_s are left out.

    What lies before the first tick, as the stamp of its scan does, counts as its time.
    """
    stretches: list[Interval] = []
    for time_s in times_s[holds].clip(min=0.0).tolist():
        if stretches and time_s - stretches[-1][1] <= joined_s:
            stretches[-1] = (stretches[-1][0], time_s)
        else:
            stretches.append((time_s, time_s))
    return tuple(stretch for stretch in stretches if stretch[1] - stretch[0] >= least_s)


def silences(times_s: NDArray[np.float64], until_s: float, least_s: float) -> tuple[Interval, ...]:
    """Where nothing came for least_s or longer between 0 and until_s; all of it where there is nothing at all."""
    edges = np.concatenate(((0.0,), np.sort(np.clip(times_s, 0.0, until_s)), (until_s,)))
    return tuple((float(edges[i]), float(edges[i + 1])) for i in np.flatnonzero(np.diff(edges) >= least_s))
