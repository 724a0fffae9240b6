"""The one value through which everything that is not deterministic enters the estimator."""

from dataclasses import dataclass, replace
from typing import Protocol

from drivers.measurements import Event, Scan, ScanLike, WheelSample
from slam.estimate import AHEAD_NS, Estimate
from slam.pose import Pose2


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """All that came in between two beats of the loop. Recorded before it is used.

    seq: number of the beat on the grid (a missed beat leaves a hole); stamp_ns: host monotonic time of the beat.
    """

    seq: int
    stamp_ns: int
    scan: ScanLike | None
    wheels: tuple[WheelSample, ...]
    events: tuple[Event, ...] = ()

    @property
    def beams(self) -> int | None:
        """How many its scan has, None without one."""
        return self.scan.ranges_m.size if isinstance(self.scan, Scan) else None


def of_its_time(tick: Tick) -> Tick:
    """The tick without what is stamped from after it, which the estimator refuses as well."""
    latest_ns = tick.stamp_ns + AHEAD_NS
    if (tick.scan is None or tick.scan.stamp_ns <= latest_ns) and all(
        sample.stamp_ns <= latest_ns for sample in tick.wheels
    ):
        return tick
    wheels = tuple(sample for sample in tick.wheels if sample.stamp_ns <= latest_ns)
    scan = tick.scan if tick.scan is None or tick.scan.stamp_ns <= latest_ns else None
    return replace(tick, scan=scan, wheels=wheels)


@dataclass(frozen=True, slots=True)
class Timing:
    """How the loop kept time on one tick; never read by the estimator.

    lateness_ns: wake-up after the grid point; missed: beats skipped before this one. stages_ns by name: "step" is all
    of the estimator, its stages follow; those after it ("hand to record", "health", ...) are of the tick before.
    """

    lateness_ns: int
    missed: int
    stages_ns: dict[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class CompletedTick:
    """One tick and what came of it.

    state_hash: of the filter after the tick; truth: the simulator's map_from_body at estimate.stamp_ns, None on a real
    rover. defect: why the step raised and ended as a prediction, "" where it did not.
    """

    tick: Tick
    estimate: Estimate
    timing: Timing
    state_hash: bytes
    truth: Pose2 | None
    defect: str = ""


@dataclass(frozen=True, slots=True)
class SinkHealth:
    """How a sink is: values waiting, values dropped since the start, and what is wrong ("" if nothing)."""

    depth: int
    dropped: int
    trouble: str = ""


class Sink(Protocol):
    """Takes what the loop produced; never blocks, drops and counts instead."""

    def put(self, completed: CompletedTick) -> None:
        """One tick, which must not change afterwards."""

    def health(self) -> SinkHealth:
        """How it is now."""

    def close(self) -> None:
        """Write out what is queued and release everything; bounded in time."""
