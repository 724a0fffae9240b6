"""Which faults a simulated laser has at a moment."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.settings.simulated_laser import FaultKind, LaserFault

ONCE = (FaultKind.POWER_CYCLE, FaultKind.CLOCK_RESET)  # they happen, and are over


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """A fault with its times on the host's clock; until_ns None: until cleared."""

    fault: LaserFault
    since_ns: int
    until_ns: int | None

    def holds_at(self, now_ns: int) -> bool:
        """True while it lasts."""
        return self.since_ns <= now_ns and (self.until_ns is None or now_ns < self.until_ns)


class FaultSchedule:
    """Faults that were asked for; used by one thread."""

    def __init__(self) -> None:
        self._faults: list[ScheduledFault] = []

    def add(self, fault: LaserFault, now_ns: int) -> None:
        """From now + start_s on, for its duration."""
        since_ns = now_ns + round(fault.start_s * 1e9)
        until_ns = None if fault.duration_s is None else since_ns + round(fault.duration_s * 1e9)
        self._faults.append(ScheduledFault(fault, since_ns, until_ns))

    def clear(self) -> None:
        """All faults are over, and those still to come do not come."""
        self._faults.clear()

    def remove(self, kind: FaultKind) -> None:
        """Faults of one kind are over."""
        self._faults = [active for active in self._faults if active.fault.kind is not kind]

    def now(self, now_ns: int) -> dict[FaultKind, LaserFault]:
        """What is wrong at this moment; a fault that happens once is named once and then forgotten."""
        self._faults = [active for active in self._faults if active.until_ns is None or now_ns < active.until_ns]
        holding = {active.fault.kind: active.fault for active in self._faults if active.holds_at(now_ns)}
        for kind in ONCE:
            if kind in holding:
                self._faults = [a for a in self._faults if not (a.fault.kind is kind and a.holds_at(now_ns))]
        return holding

    def next_change_ns(self, now_ns: int) -> int | None:
        """When the next fault begins or ends by itself."""
        edges = [edge for active in self._faults for edge in (active.since_ns, active.until_ns) if edge is not None]
        return min((edge for edge in edges if edge > now_ns), default=None)


def as_fault(fault: LaserFault | Mapping[str, Any]) -> LaserFault:
    """A fault from its fields, as they come over a pipe. Raises pydantic.ValidationError."""
    return fault if isinstance(fault, LaserFault) else LaserFault.model_validate(dict(fault))
