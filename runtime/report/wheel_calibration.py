"""What scan matching says of the wheels of a run: encoders that are stuck, and the geometry that drove."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from drivers.measurements import FloatArray, OdometryPose, WheelCounts
from runtime.calibrate.calibration import calibrate
from runtime.calibrate.drive_data import CalibrationStart, DriveData, PoseStart, check_drives
from runtime.calibrate.recorded_drives import start_from
from runtime.calibrate.result import Calibration
from runtime.calibrate.scans.laser_motion import laser_motion
from runtime.calibrate.scans.orientation import AS_BELIEVED, Orientation, orientation
from runtime.calibrate.wheel_model import DifferentialModel
from runtime.errors import DataSetError
from runtime.report.facts import RunFacts, StuckEncoder
from runtime.report.finding import Interval, intervals_where
from slam.pose import Pose2

WINDOW_S = 1.5
STILL_COUNTS = 2.0  # an encoder at an edge toggles by one
OTHER_M = 0.35  # what the other wheel must have rolled meanwhile
TURN_SHARE = 0.3  # of the other wheel's way: a turn about a wheel gives it none, whatever its counts say
TURNED_SHARE = 0.5  # of the stretch; matching begins at what the wheels say, and now and then ends near it by chance


def calibrated(facts: RunFacts) -> RunFacts:
    """The same facts with the encoders that were stuck and what this run alone says of wheels and mount.

    Counts of a stuck encoder, or of a rover that is carried, say nothing of the ground: calibration leaves them out.
    """
    stuck = tuple(_stuck_encoders(facts))
    intervals = [*facts.carried_spans(), *(interval for encoder in stuck for interval in encoder.intervals)]
    if facts.drive is not None and isinstance(facts.drive.wheels[0], OdometryPose):
        return replace(facts, orientation=_orientation(facts, facts.drive))  # there are no wheels that could be worn
    calibration = _calibration(facts, intervals)
    found = AS_BELIEVED if calibration is None else calibration.orientation
    return replace(facts, stuck_encoders=stuck, calibration=calibration, orientation=found)


def _calibration(facts: RunFacts, left_out: Sequence[Interval]) -> Calibration | None:
    """None where the run has no scans or no wheels to calibrate by."""
    if facts.drive is None:
        return None
    drive = _without(facts.drive, left_out, facts.origin_ns)
    try:
        return calibrate([drive], start_from(facts.configuration))
    except DataSetError:
        return None  # this kind of odometry has no wheels to compare


def _orientation(facts: RunFacts, drive: DriveData) -> Orientation:
    try:
        start = start_from(facts.configuration)
        check_drives([drive])
    except DataSetError:
        return AS_BELIEVED
    return orientation([drive], start) if isinstance(start, PoseStart) else AS_BELIEVED


def _without(drive: DriveData, intervals: Sequence[Interval], origin_ns: int) -> DriveData:
    """The same with all wheel counts in the intervals (s since origin_ns) marked as invalid."""
    if not intervals:
        return drive
    bounds_ns = [(origin_ns + start * 1e9, origin_ns + end * 1e9) for start, end in intervals]
    counts = [sample for sample in drive.wheels if isinstance(sample, WheelCounts)]
    inside = [any(low <= sample.stamp_ns <= high for low, high in bounds_ns) for sample in counts]
    wheels = [replace(sample, valid=sample.valid and not bad) for sample, bad in zip(counts, inside, strict=True)]
    return replace(drive, wheels=tuple(wheels))


def _stuck_encoders(facts: RunFacts) -> Iterator[StuckEncoder]:
    odometry, wheels = facts.configuration.slam.odometry, facts.wheels
    good = wheels.valid & np.isfinite(wheels.counts[:, 0])
    if odometry.model != "differential" or good.sum() < 10 or facts.ticks.times_s.size < 20:
        return
    ends = facts.ticks.times_s[facts.ticks.times_s >= WINDOW_S]
    begins, times_s = ends - WINDOW_S, wheels.times_s[good]
    counts = _between(times_s, wheels.counts[good], begins, ends)
    radii = np.array((odometry.wheel_radius_left_m, odometry.wheel_radius_right_m))
    rolled_m = np.abs(counts) * 2.0 * np.pi * radii / odometry.counts_per_rev
    sampled = np.searchsorted(times_s, ends) > np.searchsorted(times_s, begins)
    for own, side in enumerate(("left", "right")):
        still = (np.abs(counts[:, own]) <= STILL_COUNTS) & (rolled_m[:, 1 - own] >= OTHER_M) & sampled
        windows = intervals_where(ends, still, 1.0, 0.2)
        turns = _turns(facts, own) if windows else []
        stretches = [(start - WINDOW_S, end) for start, end in windows]
        intervals = tuple(stretch for stretch in stretches if _covered(stretch, turns) < TURNED_SHARE)
        if intervals:
            yield StuckEncoder(side, float(rolled_m[still, 1 - own].max()), intervals)


def _turns(facts: RunFacts, own: int) -> list[Interval]:
    """When consecutive scans agree that the rover turned about this wheel; none where there is nothing to match."""
    start = None if facts.drive is None else start_from(facts.configuration)
    if facts.drive is None or not isinstance(start, CalibrationStart):
        return []
    model = DifferentialModel(start)
    motion = laser_motion(facts.drive, model, model.start)
    offset_s = facts.seconds(facts.drive.origin_ns)
    ways_m = np.array([_wheel_ways_m(mean, start) for mean in motion.means]).reshape(-1, 2)
    about = np.abs(ways_m[:, own]) < TURN_SHARE * np.abs(ways_m[:, 1 - own])
    return [(float(begin) + offset_s, float(end) + offset_s) for begin, end in motion.times_s[about]]


def _wheel_ways_m(mean: FloatArray, start: CalibrationStart) -> tuple[float, float]:
    """Way of the left and the right wheel while the laser moved by mean (3,)."""
    mount = start.body_from_laser
    body = mount @ Pose2(*mean.tolist()) @ mount.inverse()
    half_turn_m = 0.5 * start.tread_m * body.heading_rad
    return body.x_m - half_turn_m, body.x_m + half_turn_m


def _covered(stretch: Interval, parts: list[Interval]) -> float:
    """Share of the stretch that lies in the parts, which do not overlap."""
    inside_s = sum(max(0.0, min(end, stretch[1]) - max(begin, stretch[0])) for begin, end in parts)
    return inside_s / (stretch[1] - stretch[0])


def _between(times_s: FloatArray, values: FloatArray, begins: FloatArray, ends: FloatArray) -> FloatArray:
    columns = [np.interp(ends, times_s, column) - np.interp(begins, times_s, column) for column in values.T]
    return np.stack(columns, axis=-1)
