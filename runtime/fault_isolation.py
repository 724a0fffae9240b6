"""Stages that cannot stop the loop, whatever they raise: the step, through which replay goes as well, and the sinks."""

import traceback
from typing import Protocol

from drivers.measurements import Event, ScanLike, Severity, WheelSample
from runtime.commands import told_pose
from runtime.tick import CompletedTick, Sink, Tick
from slam.estimate import Estimate, unknown_pose
from slam.recognise.prior import PosePrior


class Stepping(Protocol):
    """What loop and replay need of the Estimator."""

    def step(
        self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
    ) -> Estimate:
        """The estimate at stamp_ns. told: where a command says that the rover is."""

    def state_hash(self) -> bytes:
        """16 bytes over the state."""


def step_or_predict(estimator: Stepping, tick: Tick) -> tuple[Estimate, tuple[Event, ...]]:
    """The estimate of this tick, and what went wrong.

    A defect in the estimator ends the tick as a prediction without the scan; the scan stands in the record of
    this tick, so that the defect can be repeated. Where predicting fails as well, nothing is known of the pose.
    """
    try:
        return estimator.step(tick.stamp_ns, tick.scan, tick.wheels, told_pose(tick.events)), ()
    except Exception as error:  # noqa: BLE001 - whatever it is, the rover needs its next pose
        defect = _defect(tick, error, "as a prediction")
    try:
        return estimator.step(tick.stamp_ns, None, ()), (defect,)
    except Exception as error:  # noqa: BLE001 - nor does this end the run
        nothing = _defect(tick, error, "without a pose")
        return unknown_pose(tick.stamp_ns, f"the estimator failed: {nothing.reason}"), (defect, nothing)


def _defect(tick: Tick, error: Exception, ended: str) -> Event:
    """What was raised, where, and how the tick ended."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    reason = f"{type(error).__name__}: {error} in {where.name}; tick {tick.seq} ended {ended}"
    return Event(tick.stamp_ns, "estimator", "defect", reason, Severity.ERROR)


def defects_line(defects: int, ticks: int, reason: str) -> str:
    """How many steps of a run raised, for a person."""
    return f"DEFECT    {defects} of {ticks} steps raised and ended as predictions; the first: {reason}"


def put_or_report(name: str, sink: Sink, completed: CompletedTick) -> tuple[Event, ...]:
    """Hand one tick to a sink; a sink that raises loses this tick and says so in the record of the next one."""
    try:
        sink.put(completed)
    except Exception as error:  # noqa: BLE001 - the rover needs its pose, whatever a sink thinks of it
        tick = completed.tick
        reason = f"{type(error).__name__}: {error}; the sink {name} lost tick {tick.seq}"
        return (Event(tick.stamp_ns, name, "defect", reason, Severity.ERROR),)
    return ()
