"""Events that come again and again as one row: a page of hundreds says less than their span and number."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.measurements import Event

AGAIN_S = 5.0  # the same within this time is the same trouble
FIGURES = re.compile(r"[-+]?\d+(\.\d+)?")


@dataclass(slots=True)
class Repeated:
    """One event, or several alike: first and last time in s, the first of them, and their number."""

    start_s: float
    end_s: float
    event: Event
    times: int = 1


def repeated(events: Sequence[Event], origin_ns: int) -> list[Repeated]:
    """In the order of their beginnings. Alike: of one source and kind, their reasons the same but for figures."""
    rows: list[Repeated] = []
    latest: dict[tuple[str, str, str], Repeated] = {}
    for event in sorted(events, key=lambda event: event.stamp_ns):
        time_s = (event.stamp_ns - origin_ns) * 1e-9
        key = (event.source, event.kind, _words(event))
        row = latest.get(key)
        if row is not None and time_s - row.end_s <= AGAIN_S:
            row.end_s, row.times = time_s, row.times + 1
            continue
        latest[key] = row = Repeated(time_s, time_s, event)
        rows.append(row)
    return rows


def _words(event: Event) -> str:
    """Of health only what it names first: reasons come and go with it from beat to beat."""
    reason = event.reason
    if event.source == "health":
        return ""
    return FIGURES.sub("#", reason.split(" (")[0])
