"""Dead reckoning between scans: one increment with an honest covariance, by the unscented transform.

The increment is expressed in the body frame at the previous scan, so that it is the same for every particle.
"""

from collections import Counter, deque
from dataclasses import dataclass, fields, replace

import numpy as np

from drivers.measurements import FloatArray, SpeedSteering, SpeedYawRate, WheelSample
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import cosine_sine
from slam.arithmetic.small_matrices import carried, product
from slam.odometry.motion import ARC, DIFFERENTIAL, RATES, SEGMENT_COLUMNS, STEERED, accumulate, arc
from slam.odometry.wheel_segments import SAMPLE_KIND, Cursor, Segmenter, Segments
from slam.pose import Pose2
from slam.settings.odometry import OdometrySettings
from slam.settings.sigma_points import unscented_weights

MAX_YAW_RATE_RADPS = 10.0  # rad/s beyond which a measured yaw rate is refused
REST_TOLERANCE_COUNTS = 1.0  # counts per scan that still are standing still: an encoder at an edge toggles by one
FARTHEST = 1e12  # counts or metres beyond which a total is garbage
LONGEST = 1e9  # metres, radians or their squares between two scans, beyond which the motion is none
STEEPEST_RAD = 1.4
LONG_QUEUE = 150  # samples; 3 s at 50 Hz
SETTLED_NS = 1_000_000_000  # a scan is never handed over later than this
MODELS = {"differential": DIFFERENTIAL, "steered": STEERED, "speed_yaw_rate": RATES, "pose": ARC}


@dataclass(frozen=True, slots=True, eq=False)
class Increment:
    """Motion since the last scan in the body frame of then.

    mean (3,): x m, y m, heading rad; covariance (3, 3); at_rest: the wheels say that nothing moved;
    speed_mps, lateral_mps, yaw_rate_radps: mean velocities; known: False if wheels were silent for a part of it.
    rolling_s: for how long it moved, or may have.
    """

    mean: FloatArray
    covariance: FloatArray
    at_rest: bool
    known: bool
    duration_s: float
    speed_mps: float
    lateral_mps: float
    yaw_rate_radps: float
    rolling_s: float

    def as_pose(self) -> Pose2:
        """before_from_after."""
        return Pose2(float(self.mean[0]), float(self.mean[1]), float(self.mean[2]))


@dataclass(slots=True, eq=False)
class Travel:
    """Sums over segments since the last stamp taken.

    mean (3,), covariance (3, 3) by the unscented transform; tracks (1 + s, 3): the same motion without noise, nominal
    and with each constant of the geometry off by one deviation; counts (2,) of either wheel, both directions added up.
    """

    mean: FloatArray
    covariance: FloatArray
    tracks: FloatArray
    counts: FloatArray
    moving_s: float = 0.0
    rolling_s: float = 0.0
    forward_m: float = 0.0
    lateral_m: float = 0.0
    turn_rad: float = 0.0
    known: bool = True
    began: bool = False
    moved: bool = False
    gap_correction_m: tuple[float, float] = (0.0, 0.0)
    rounded: bool = False

    @classmethod
    def none(cls, geometries: FloatArray) -> "Travel":
        """Standing at the last stamp taken."""
        return cls(np.zeros(3), np.zeros((3, 3)), np.zeros((len(geometries), 3)), np.zeros(2))

    @property
    def is_sound(self) -> bool:
        """Whether all of it are numbers that a motion can have: at a steering angle close to a right one it is none."""
        sums = (self.forward_m, self.lateral_m, self.turn_rad, *self.gap_correction_m)
        parts = (self.mean, self.covariance, self.tracks, np.array(sums))
        return all((np.abs(part) < LONGEST).all() for part in parts)  # false for NaN

    def copy(self) -> "Travel":
        """The same, to be added to."""
        return replace(
            self,
            mean=self.mean.copy(),
            covariance=self.covariance.copy(),
            tracks=self.tracks.copy(),
            counts=self.counts.copy(),
        )


class Odometry:
    """Takes wheel samples as they come and gives the motion up to any stamp, exact arcs and interpolation included."""

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._segmenter = Segmenter(settings)
        self._weights = unscented_weights(5)
        self._model = MODELS[settings.model]
        self._kind = SAMPLE_KIND[settings.model]
        self._geometries = _geometries(settings)
        self._queue: deque[WheelSample] = deque()
        self._cursor = Cursor()
        self._newest_ns: int | None = None
        self._taken_ns: int | None = None
        self._travel = Travel.none(self._geometries)
        self.odom_from_body = Pose2()
        self.refused = Counter[str](wheel_stamps=0, wheel_values=0, wheel_kinds=0, wheel_jumps=0)

    def add(self, wheels: tuple[WheelSample, ...], latest_ns: int | None = None) -> None:
        """Queue new samples; those out of order, not plausible or of another kind are refused and counted.

        latest_ns: so are those from after it, or every later sample would be out of order; None: there is no bound.
        """
        for sample in wheels:
            if latest_ns is not None and sample.stamp_ns > latest_ns:
                self.refused["wheel_stamps_ahead"] += 1
            elif not isinstance(sample, self._kind):
                self.refused["wheel_kinds"] += 1
            elif not self._plausible(sample):
                self.refused["wheel_values"] += 1
            elif self._newest_ns is not None and sample.stamp_ns <= self._newest_ns:
                self.refused["wheel_stamps"] += 1
            else:
                self._newest_ns = sample.stamp_ns
                self._queue.append(sample)

    def take_until(self, stamp_ns: int) -> Increment:
        """The increment from the last stamp taken to this one, which becomes the last one taken."""
        self._consume(self._travel, stamp_ns)
        travel = self._sound(self._travel, stamp_ns)
        if travel is not self._travel:
            self.refused["wheel_motions"] += 1
        increment = self._increment(travel, stamp_ns)
        self._travel = Travel.none(self._geometries)
        self._taken_ns = stamp_ns
        self.odom_from_body = self.odom_from_body @ Pose2(*(float(value) for value in travel.tracks[0]))
        if travel.gap_correction_m != (0.0, 0.0):
            self.odom_from_body = self.odom_from_body @ self._arc(*travel.gap_correction_m)
        return increment

    def begin_anew(self) -> None:
        """The clock was set back: what is queued is dropped, and motion up to the next sample is not known."""
        self._queue.clear()
        self._cursor = Cursor()
        self._newest_ns = self._taken_ns = None
        self._add(self._travel, self._segmenter.unknown(SETTLED_NS * 1e-9))

    def predicted(self, stamp_ns: int) -> Increment:
        """The increment from the last stamp taken to this one; another call may take or predict an earlier one."""
        if len(self._queue) > LONG_QUEUE:  # no scan for seconds: what lies well behind need not be added up again
            self._consume(self._travel, stamp_ns - SETTLED_NS)
        segments, _, _ = self._segmenter.until(self._cursor, self._queue, stamp_ns)
        travel = self._travel.copy()
        self._add(travel, segments)
        return self._increment(self._sound(travel, stamp_ns), stamp_ns)

    def _sound(self, travel: "Travel", stamp_ns: int) -> "Travel":
        """The travel up to a stamp, or, where that is none, that the wheels have said nothing of it."""
        if travel.is_sound:
            return travel
        unknown = Travel.none(self._geometries)
        since_ns = stamp_ns if self._taken_ns is None else self._taken_ns
        self._add(unknown, self._segmenter.unknown((stamp_ns - since_ns) * 1e-9))
        return unknown

    def _consume(self, travel: "Travel", stamp_ns: int) -> None:
        """Add the motion up to this stamp for good."""
        segments, self._cursor, used = self._segmenter.until(self._cursor, self._queue, stamp_ns)
        for _ in range(used):
            self._queue.popleft()
        self.refused["wheel_jumps"] += segments.jumps
        self._add(travel, segments)

    def _plausible(self, sample: WheelSample) -> bool:
        """True for finite numbers that a vehicle can have."""
        if not all(abs(getattr(sample, field.name)) < FARTHEST for field in fields(sample)[1:]):
            return False
        if isinstance(sample, SpeedSteering):
            return abs(sample.speed_mps) <= self._settings.jump_speed_mps and abs(sample.steering_rad) < STEEPEST_RAD
        if isinstance(sample, SpeedYawRate):
            limit = MAX_YAW_RATE_RADPS
            return abs(sample.speed_mps) <= self._settings.jump_speed_mps and abs(sample.yaw_rate_radps) <= limit
        return True

    def _add(self, travel: "Travel", segments: Segments) -> None:
        """Carry the sums over some more segments."""
        rows = segments.rows
        distances, turns = self._moves(rows)
        travel.known = travel.known and segments.known
        (left_m, right_m), more_m = travel.gap_correction_m, segments.gap_correction_m
        travel.gap_correction_m = (left_m + more_m[0], right_m + more_m[1])
        travel.counts += np.abs(rows[:, 1:3]).sum(axis=0) / max(self._segmenter.count_m, 1e-12)
        travel.moved = travel.moved or bool(distances.any() or turns.any())
        travel.began = travel.began or len(rows) > 0
        if len(rows) > 0 and not travel.rounded and not self._rests(travel) and self._model == DIFFERENTIAL:
            # both ends of the increment fall somewhere within a count
            rows[0, 4:6] += squared(self._segmenter.count_m) / 6.0
            travel.rounded = True
        accumulate(travel.mean, travel.covariance, travel.tracks, rows, self._model, self._geometries, self._weights)
        travel.moving_s += float(rows[:, 0].sum())
        travel.rolling_s += float(rows[(distances != 0.0) | (turns != 0.0), 0].sum())
        travel.forward_m += float(distances.sum())
        travel.lateral_m += float(rows[:, 3].sum())
        travel.turn_rad += float(turns.sum())

    def _arc(self, left_m: float, right_m: float) -> Pose2:
        """Where the body is after both wheels have rolled that far evenly, from where it was."""
        travel = Travel.none(self._geometries)
        row = np.zeros((1, SEGMENT_COLUMNS))
        row[0, :3] = (1.0, left_m, right_m)
        accumulate(travel.mean, travel.covariance, travel.tracks, row, self._model, self._geometries, self._weights)
        return Pose2(*(float(value) for value in travel.tracks[0]))

    def _rests(self, travel: "Travel") -> bool:
        """Whether the wheels say that nothing has moved."""
        tolerance = REST_TOLERANCE_COUNTS if self._model == DIFFERENTIAL else 0.0
        still = float(travel.counts.max()) <= tolerance or not travel.moved
        return travel.known and travel.began and still

    def _increment(self, travel: "Travel", stamp_ns: int) -> Increment:
        """The sums as an increment, with what constant errors of the geometry add."""
        constant = travel.tracks[1:] - travel.tracks[0]
        covariance = travel.covariance + product(constant.T, constant)
        duration = (stamp_ns - self._taken_ns) * 1e-9 if self._taken_ns is not None else 0.0
        rests = self._rests(travel)
        per_second = 1.0 / travel.moving_s if travel.moving_s > 0.0 else 0.0
        return Increment(
            travel.mean.copy(),
            0.5 * (covariance + covariance.T),
            rests,
            travel.known,
            duration,
            travel.forward_m * per_second,
            travel.lateral_m * per_second,
            travel.turn_rad * per_second,
            0.0 if rests else travel.rolling_s if travel.known else duration,
        )

    def _moves(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances m and turns rad of the segments, (n,) each."""
        moves = [arc(self._model, self._geometries[0], row[0], row[1], row[2]) for row in rows]
        pairs = np.array(moves).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]


def _geometries(settings: OdometrySettings) -> FloatArray:
    """(1 + s, 7) for slam.motion.accumulate: nominal, then one row per constant that is not known exactly."""
    nominal = np.array(
        (
            settings.tread_m,
            settings.wheel_base_m,
            settings.speed_wheel_offset_m,
            settings.steering_scale,
            settings.steering_bias_rad,
            1.0,
            1.0,
        )
    )
    if settings.model != "differential":
        return nominal[np.newaxis]
    uncertain = (
        (0, settings.tread_uncertainty * settings.tread_m),
        (5, settings.radius_uncertainty),
        (6, settings.radius_uncertainty),
    )
    rows = [nominal]
    for constant, deviation in uncertain:
        if deviation > 0.0:
            moved = nominal.copy()
            moved[constant] += deviation
            rows.append(moved)
    return np.array(rows)


def compound(pose: Pose2, covariance: FloatArray, increment: Increment) -> FloatArray:
    """Covariance (3, 3) of pose (+) increment, first order."""
    moved = pose @ increment.as_pose()
    by_pose = np.eye(3)
    by_pose[0, 2], by_pose[1, 2] = pose.y_m - moved.y_m, moved.x_m - pose.x_m
    cosine, sine = cosine_sine(pose.heading_rad)
    turned = np.array(((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)))
    total: FloatArray = carried(by_pose, covariance) + carried(turned, increment.covariance)
    return 0.5 * (total + total.T)
