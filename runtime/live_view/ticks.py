"""What a rover says over zenoh, put together tick by tick as the review draws them."""

import json
import math
from typing import Any

import numpy as np

from drivers.measurements import Event, FloatArray, Scan, Severity, uniform_bearings
from runtime.messages.definitions import deserialize
from runtime.messages.tick import decode
from runtime.printable import printable
from runtime.publish.follow import Message
from runtime.publish.rover_status import believed
from runtime.review.ticks import AssembledTick
from runtime.ros2.poses import PATH, POSES
from runtime.tick import Tick, Timing
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.pose import Pose2, wrap_rad

HEARD = ("pose", "odom", "scan_full", "particles", "status", "event")
MOST_LANDMARKS = 50_000
MOST_EVENTS = 200  # between two poses
FAR_NS = 1 << 62
FARTHEST_M = 1e6
NOWHERE = np.zeros((3, 3))


class LiveTicks:
    """Takes messages as they come; each pose ends the tick of the one before. Anyone may have sent them.

    Stamps are the rover's wall time.
    """

    def __init__(self, rover: str) -> None:
        self._rover = rover
        self._pose: tuple[int, Pose2, FloatArray] | None = None
        self._odom = Pose2()
        self._scan: Scan | None = None
        self._particles: FloatArray | None = None
        self._landmarks: LandmarkMap | None = None
        self._events: list[Event] = []
        self._status: dict[str, Any] = {}
        self._is_told = False  # a status since the last pose: its figures are drawn once
        self._seq = 0

    def take(self, message: Message) -> AssembledTick | None:
        """The tick that this message ends. What makes no sense is passed over."""
        try:
            match message.name:
                case "pose":
                    return self._next(decode("/pose", message.data))
                case "odom":
                    self._odom = _pose_of(decode("/odom", message.data).pose.pose)
                case "scan_full":
                    self._scan = _scan_of(decode("/scan", message.data))
                case "particles":
                    poses = [_pose_of(pose).as_array() for pose in deserialize(POSES, message.data).poses]
                    self._particles = np.array(poses).reshape(-1, 3)
                case "status":
                    self._status = believed(f"infant/{self._rover}/status", message.data)
                    self._is_told = True
                case "event":
                    self._events = [*self._events, _event_of(json.loads(message.data))][-MOST_EVENTS:]
                case "map":
                    self._landmarks = _landmarks_of(json.loads(message.data))
        except (ValueError, KeyError, TypeError, IndexError, ArithmeticError, RecursionError):
            pass  # a stranger's: the rover's own come ten times a second
        return None

    def _next(self, message: Any) -> AssembledTick | None:
        pose = _pose_of(message.pose.pose)
        covariance = message.pose.covariance.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
        if not np.isfinite(covariance).all():
            return None
        ended = None if self._pose is None else self._assembled(*self._pose)
        self._pose = _stamp_ns(message), pose, covariance
        self._scan = self._particles = self._landmarks = None
        self._events, self._is_told = [], False
        return ended

    def _assembled(self, stamp_ns: int, pose: Pose2, covariance: FloatArray) -> AssembledTick:
        tick = Tick(self._status.get("seq") or self._seq, stamp_ns, self._scan, (), tuple(self._events))
        self._seq += 1
        particles, scan = self._particles, self._scan
        estimate = Estimate(
            stamp_ns,
            pose,
            covariance,
            pose,
            NOWHERE,
            self._odom,
            _quality_of(self._status.get("quality")),
            particles=particles,
            particle_weights=None if particles is None else np.full(len(particles), 1.0 / max(1, len(particles))),
            beam_verdicts=None if scan is None else np.zeros(scan.ranges_m.size, np.uint8),
            landmarks=self._landmarks,
            counts=self._counts(),
        )
        return AssembledTick(tick, estimate=estimate, timing=self._timing())

    def _counts(self) -> dict[str, float]:
        landmarks = self._status.get("landmarks") if self._is_told else None
        return {} if landmarks is None else {"landmarks": float(landmarks), **(self._status["filter"] or {})}

    def _timing(self) -> Timing | None:
        lateness_ms, step_ms = self._status.get("lateness_ms"), self._status.get("step_ms")
        if not self._is_told or lateness_ms is None or step_ms is None:
            return None
        return Timing(round(lateness_ms * 1e6), 0, {"step": round(step_ms * 1e6)})


def path_of(data: bytes) -> FloatArray:
    """Positions (n, 2) of a path. Raises ValueError."""
    poses = [_pose_of(stamped.pose) for stamped in deserialize(PATH, data).poses]
    return np.array([(pose.x_m, pose.y_m) for pose in poses]).reshape(-1, 2)


def _pose_of(pose: Any) -> Pose2:
    turn = pose.orientation
    found = Pose2(pose.position.x, pose.position.y, wrap_rad(2.0 * math.atan2(turn.z, turn.w)))
    if not (np.abs(found.as_array()) < FARTHEST_M).all():  # of NaN too
        raise ValueError("a pose that is not finite")
    return found


def _scan_of(message: Any) -> Scan:
    ranges_m, period_s, first = message.ranges.copy(), message.time_increment, 0
    bearings_rad = uniform_bearings(message.angle_min, message.angle_increment, ranges_m.size)
    if message.angle_increment < 0.0:
        ranges_m, bearings_rad = ranges_m[::-1].copy(), bearings_rad[::-1].copy()
        period_s, first = -period_s, ranges_m.size - 1
    return Scan(_stamp_ns(message), ranges_m, bearings_rad, period_s, first, message.range_max)


def _landmarks_of(said: dict[str, Any]) -> LandmarkMap:
    identities = np.array(said["identities"][:MOST_LANDMARKS], np.int64)
    means_m = np.array(said["means_m"][:MOST_LANDMARKS], np.float64).reshape(-1, 2)
    covariances_m2 = np.array(said["covariances_m2"][:MOST_LANDMARKS], np.float64).reshape(-1, 2, 2)
    existence = np.array(said["existence"][:MOST_LANDMARKS], np.float64).clip(1e-3, 1.0 - 1e-3)
    if not len(identities) == len(means_m) == len(covariances_m2) == len(existence):
        raise ValueError("arrays of different lengths in a map")
    if not (np.isfinite(means_m).all() and np.isfinite(covariances_m2).all()):
        raise ValueError("a map that is not finite")
    return LandmarkMap(identities, means_m, covariances_m2, np.log(existence / (1.0 - existence)))


def _event_of(said: dict[str, Any]) -> Event:
    source, kind, reason = (printable(str(said[name]), 300) for name in ("source", "kind", "reason"))
    stamp_ns = int(said["stamp_ns"])
    if abs(stamp_ns) > FAR_NS:
        raise ValueError("a stamp that is out of range")
    return Event(stamp_ns, source, kind, reason, Severity(said["severity"]))


def _quality_of(said: Any) -> Quality:
    return Quality(said) if said in tuple(Quality) else Quality.UNCERTAIN


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
