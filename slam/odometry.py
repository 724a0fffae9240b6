"""Dead reckoning between scans: one increment with an honest covariance, by the unscented transform.

The increment is expressed in the body frame at the previous scan, so that it is the same for every particle.
"""

from collections import deque
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import SpeedSteering, SpeedYawRate, WheelSample
from slam.motion import ARC, DIFFERENTIAL, RATES, STEERED, accumulate, arc
from slam.odometry_settings import OdometrySettings
from slam.pose import Pose2
from slam.unscented import UnscentedSettings, unscented_weights
from slam.wheel_segments import SAMPLE_KIND, Cursor, Segmenter, Segments

FloatArray = NDArray[np.float64]
FARTHEST = 1e12  # counts or metres beyond which a total is garbage
STEEPEST_RAD = 1.4
MODELS = {"differential": DIFFERENTIAL, "steered": STEERED, "speed_yaw_rate": RATES, "pose": ARC}


@dataclass(frozen=True, slots=True, eq=False)
class Increment:
    """Motion since the last scan in the body frame of then.

    mean (3,): x m, y m, heading rad; covariance (3, 3); at_rest: the wheels say that nothing moved;
    speed_mps, lateral_mps, yaw_rate_radps: mean velocities; known: False if wheels were silent for a part of it.
    """

    mean: FloatArray
    covariance: FloatArray
    at_rest: bool
    known: bool
    duration_s: float
    speed_mps: float
    lateral_mps: float
    yaw_rate_radps: float

    def as_pose(self) -> Pose2:
        """before_from_after."""
        return Pose2(float(self.mean[0]), float(self.mean[1]), float(self.mean[2]))


class Odometry:
    """Takes wheel samples as they come and gives the motion up to any stamp, exact arcs and interpolation included."""

    def __init__(self, settings: OdometrySettings, unscented: UnscentedSettings) -> None:
        self._settings = settings
        self._segmenter = Segmenter(settings)
        self._weights = unscented_weights(5, unscented)
        self._model = MODELS[settings.model]
        self._kind = SAMPLE_KIND[settings.model]
        self._geometries = _geometries(settings)
        self._queue: deque[WheelSample] = deque()
        self._cursor = Cursor()
        self._newest_ns: int | None = None
        self._taken_ns: int | None = None
        self.odom_from_body = Pose2()
        self.refused: dict[str, int] = {"wheel_stamps": 0, "wheel_values": 0, "wheel_kinds": 0, "wheel_jumps": 0}

    def add(self, wheels: tuple[WheelSample, ...]) -> None:
        """Queue new samples; those out of order, not plausible or of another kind are refused and counted."""
        for sample in wheels:
            if not isinstance(sample, self._kind):
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
        segments, self._cursor, used = self._segmenter.until(self._cursor, self._queue, stamp_ns)
        for _ in range(used):
            self._queue.popleft()
        self.refused["wheel_jumps"] += segments.jumps
        increment, nominal = self._integrate(segments, stamp_ns)
        self._taken_ns = stamp_ns
        self.odom_from_body = self.odom_from_body @ nominal
        return increment

    def predicted(self, stamp_ns: int) -> Increment:
        """The increment from the last stamp taken to this one; nothing is consumed."""
        segments, _, _ = self._segmenter.until(self._cursor, self._queue, stamp_ns)
        return self._integrate(segments, stamp_ns)[0]

    def _plausible(self, sample: WheelSample) -> bool:
        """True for finite numbers that a vehicle can have."""
        if not all(abs(value) < FARTHEST for value in astuple(sample)[1:]):
            return False
        if isinstance(sample, SpeedSteering):
            return abs(sample.speed_mps) <= self._settings.max_speed_mps and abs(sample.steering_rad) < STEEPEST_RAD
        if isinstance(sample, SpeedYawRate):
            limit = self._settings.max_yaw_rate_radps
            return abs(sample.speed_mps) <= self._settings.max_speed_mps and abs(sample.yaw_rate_radps) <= limit
        return True

    def _integrate(self, segments: Segments, stamp_ns: int) -> tuple[Increment, Pose2]:
        """Increment, and the same motion without any noise for dead reckoning."""
        rows = segments.rows
        counts = np.abs(rows[:, 1:3]).sum(axis=0).max(initial=0.0) / max(self._segmenter.count_m, 1e-12)
        tolerance = self._settings.rest_tolerance_counts if self._model == DIFFERENTIAL else 0.0
        distances, turns = self._moves(rows)
        at_rest = segments.known and len(rows) > 0 and (counts <= tolerance or not (distances.any() or turns.any()))
        if not at_rest and self._model == DIFFERENTIAL and len(rows) > 0:
            # both ends of the increment fall somewhere within a count
            rows[0, 4:6] += self._segmenter.count_m**2 / 6.0
        mean, covariance = np.zeros(3), np.zeros((3, 3))
        tracks = np.zeros((len(self._geometries), 3))
        accumulate(mean, covariance, tracks, rows, self._model, self._geometries, self._weights)
        constant = tracks[1:] - tracks[0]
        covariance += constant.T @ constant
        duration = (stamp_ns - self._taken_ns) * 1e-9 if self._taken_ns is not None else 0.0
        moving = float(rows[:, 0].sum())
        per_second = 1.0 / moving if moving > 0.0 else 0.0
        increment = Increment(
            mean,
            0.5 * (covariance + covariance.T),
            bool(at_rest),
            segments.known,
            duration,
            float(distances.sum()) * per_second,
            float(rows[:, 3].sum()) * per_second,
            float(turns.sum()) * per_second,
        )
        return increment, Pose2(*(float(value) for value in tracks[0]))

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
