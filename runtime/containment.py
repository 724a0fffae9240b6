"""One step of the estimator that cannot stop the loop; live and replay both go through here."""

import traceback
from typing import Protocol

from drivers.measurements import Event, ScanLike, Severity, WheelSample
from runtime.tick import Tick
from slam.estimate import Estimate


class Stepping(Protocol):
    """What loop and replay need of the Estimator."""

    def step(self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...]) -> Estimate:
        """The estimate at stamp_ns."""

    def state_hash(self) -> bytes:
        """16 bytes over the state."""


def contained_step(estimator: Stepping, tick: Tick) -> tuple[Estimate, tuple[Event, ...]]:
    """The estimate of this tick, and what went wrong.

    A defect in the estimator ends the tick as a prediction without the scan; the scan stands in the record of
    this tick, so that the defect can be repeated. Raises only if predicting fails as well.
    """
    try:
        return estimator.step(tick.stamp_ns, tick.scan, tick.wheels), ()
    except Exception as error:  # noqa: BLE001 - whatever it is, the rover needs its next pose
        where = traceback.extract_tb(error.__traceback__)[-1]
        defect = Event(
            tick.stamp_ns,
            "estimator",
            "defect",
            f"{type(error).__name__}: {error} in {where.name}; tick {tick.seq} ended as a prediction",
            Severity.ERROR,
        )
        return estimator.step(tick.stamp_ns, None, ()), (defect,)
