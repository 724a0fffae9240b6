"""The records of a run put together again, tick by tick, as the review draws them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import Event, FloatArray, Scan, Severity
from runtime.messages.estimate import decode_estimate
from runtime.messages.ros import decode_ranges_m
from runtime.messages.tick import Record, decode_gap, decode_tick, decode_timing, decode_truth
from runtime.tick import Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

ELAPSED, TICK = "elapsed", "tick"
"""The two timelines: seconds since the first tick, and the number of the tick."""


@dataclass(slots=True)
class AssembledTick:
    """One tick and what came of it; what was not recorded is None. losses: what the record says it lost before."""

    tick: Tick
    losses: tuple[Event, ...] = ()
    estimate: Estimate | None = None
    timing: Timing | None = None
    truth: Pose2 | None = None


class TickAssembler:
    """Takes records in the order of writing and gives each tick when the next one begins."""

    def __init__(self) -> None:
        self._ranges_m: NDArray[np.float32] | None = None
        self._losses: list[Event] = []
        self._current: AssembledTick | None = None

    def feed(self, record: Record) -> AssembledTick | None:
        """The tick before this record if the record begins another, else None."""
        assembled = self._current
        match record.topic:
            case "/scan":
                self._ranges_m = decode_ranges_m(record.data)
            case "/tick":
                self._begin(record)
                return assembled
            case "/gap":
                gap = decode_gap(record.data)
                reason = f"{gap.ticks} tick(s) and {gap.raw} raw message(s) lost: {gap.reason}"
                self._losses.append(Event(gap.stamp_ns, "record", "gap", reason, Severity.WARN))
            case "/estimate" if assembled is not None:
                assembled.estimate = decode_estimate(record.data)
            case "/timing" if assembled is not None:
                assembled.timing = decode_timing(record.data)
            case "/truth" if assembled is not None:
                assembled.truth = decode_truth(record.data)
        return None

    def last(self) -> AssembledTick | None:
        """The tick that no other has followed."""
        assembled, self._current = self._current, None
        return assembled

    def _begin(self, record: Record) -> None:
        try:
            tick = decode_tick(record.data, self._ranges_m)
        except ValueError:
            reason = "a tick is not drawn: its scan was lost on the way to the drawing process; infant review draws it"
            self._losses.append(Event(record.stamp_ns, "review", "incomplete", reason, Severity.WARN))
            self._current = None
        else:
            self._current = AssembledTick(tick, tuple(self._losses))
            self._losses.clear()
        self._ranges_m = None


@dataclass(frozen=True, slots=True)
class Motion:
    """How the body moved around the stamp of an estimate, by the odometry between it and the one before.

    The estimate is for the beat; what the laser saw lies some hundredths of a second before. Drawn with the
    beat's pose, walls would smear by metres in a turn.
    """

    stamp_ns: int
    map_from_body: Pose2
    span_ns: int
    body_from_body_before: Pose2

    @classmethod
    def between(cls, before: Estimate | None, now: Estimate) -> "Motion":
        """Of two estimates in a row; at rest when there is only one, or a long time lies between."""
        span_ns = 0 if before is None else now.stamp_ns - before.stamp_ns
        if before is None or not 0 < span_ns <= 1_000_000_000:
            return cls(now.stamp_ns, now.map_from_body, 1, Pose2())
        return cls(now.stamp_ns, now.map_from_body, span_ns, now.odom_from_body.inverse() @ before.odom_from_body)

    def map_from_body_at(self, stamp_ns: int) -> Pose2:
        """Pose at this stamp, for what was seen at one time."""
        before, share = self.body_from_body_before, min(max((self.stamp_ns - stamp_ns) / self.span_ns, -1.0), 3.0)
        return self.map_from_body @ Pose2(share * before.x_m, share * before.y_m, share * before.heading_rad)

    def to_map(self, stamps_ns: NDArray[np.int64], points_m: FloatArray, body_from_laser: Pose2) -> FloatArray:
        """Points (N, 2) of the laser's frame, each seen at its own stamp (N,), in the map frame.

        Each is turned once, by all three angles together: mount, motion since the scan, pose.
        """
        before, pose, mount = self.body_from_body_before, self.map_from_body, body_from_laser
        share = np.maximum(np.minimum((self.stamp_ns - stamps_ns) / self.span_ns, 3.0), -1.0)
        angles_rad = pose.heading_rad + share * before.heading_rad
        cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
        x, y = mount.transform(points_m).T
        way = pose @ Pose2(before.x_m, before.y_m)
        places_m = np.empty_like(points_m)
        places_m[:, 0] = pose.x_m + (way.x_m - pose.x_m) * share + cosine * x - sine * y
        places_m[:, 1] = pose.y_m + (way.y_m - pose.y_m) * share + sine * x + cosine * y
        return places_m


class BeamPoints:
    """Beams as points; the directions of a laser that looks where it looked before are not reckoned anew."""

    def __init__(self) -> None:
        self._bearings_rad: FloatArray = np.empty(0)
        self._directions: FloatArray = np.empty((0, 2))

    def of(self, scan: Scan) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
        """Numbers (n,), stamps (n,) and points (n, 2) in the laser's frame, of every beam that came back."""
        if scan.bearings_rad is not self._bearings_rad:
            self._bearings_rad = scan.bearings_rad
            self._directions = np.stack((np.cos(scan.bearings_rad), np.sin(scan.bearings_rad)), axis=-1)
        beams = np.flatnonzero(np.isfinite(scan.ranges_m) & (scan.ranges_m < scan.range_max_m))
        stamps_ns = scan.stamp_ns + ((beams - scan.stamp_beam) * (scan.beam_period_s * 1e9)).astype(np.int64)
        return beams, stamps_ns, scan.ranges_m[beams, None].astype(np.float64) * self._directions[beams]
