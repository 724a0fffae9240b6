"""The map of what has been seen since the pose came into doubt: what is looked for in the maps that are known."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.estimate import KeyframeFit, MapProgress
from slam.front_end.deskew import Beams
from slam.joint.evidence import Confidence
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.observations import FeatureRows
from slam.odometry.odometry import Increment
from slam.pose import Pose2
from slam.quality import QualityMonitor
from slam.scan_search.stretch import NO_POINTS, PointArray
from slam.visibility import SightLine


@dataclass(frozen=True, slots=True, eq=False)
class ScanSeen:
    """One scan as the joint Gaussian was told of it: motion since the scan before, features, how far it looked.

    laid: its beams where it was laid onto others, or can be laid onto keyframes; points_m (p, 2): some of its returns
    then, body frame.
    """

    stamp_ns: int
    increment_mean: FloatArray
    increment_covariance: FloatArray
    rows: FeatureRows
    sight: SightLine
    seen_before_share: float | None
    points_m: PointArray = field(default_factory=NO_POINTS.copy)
    laid: Beams | None = None

    @property
    def way_m(self) -> float:
        """Since the scan before."""
        return math.hypot(*self.increment_mean[:2].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class ScanTaken:
    """What the joint Gaussian was told by one scan and made of it, for whoever smooths the path when the drive is over.

    measured: motion since the scan before by wheels and scans laid onto the last ones, and nothing else.
    odom_from_body: dead reckoning. matched (K,): identity or verdict of each feature. fits: how the scan lies on
    keyframes. before, after: the map, once the scan was taken, and once a place may have been recognised; the pose is
    from then.
    """

    seen: ScanSeen
    measured: Increment
    odom_from_body: Pose2
    matched: IntArray
    fits: tuple[KeyframeFit, ...]
    before: MapProgress
    after: MapProgress
    map_from_body: Pose2
    covariance: FloatArray


def no_witness(taken: ScanTaken) -> None:
    """Nobody smooths the path afterwards."""


class LocalMap:
    """A joint Gaussian of its own, begun where the other one believes to be, and whether it can be believed itself.

    keyframes: of this map; walls hold its heading as they hold that of any other. since_ns, driven_m: when doubt began,
    and how far the rover has driven since.
    """

    def __init__(
        self,
        joint: JointGaussian,
        keyframes: Keyframes,
        monitor: QualityMonitor,
        like: JointGaussian,
        stamp_ns: int,
    ) -> None:
        self.joint, self.keyframes = joint, keyframes
        self._monitor = monitor
        self.since_ns = stamp_ns
        self.driven_m = 0.0
        self._moved = Pose2()
        joint.state.mean[:3] = like.map_from_body.as_array()
        joint.scans, joint.moves = like.scans - 1, like.moves - 1

    def follow(self, seen: ScanSeen, *, first: bool) -> None:
        """One scan more. first: the map begins with it, so that everything may become a landmark."""
        still = np.zeros(3), np.zeros((3, 3))
        motion = still if first else (seen.increment_mean, seen.increment_covariance)
        self.driven_m += seen.way_m
        before = self.joint.map_from_body
        self.joint.predict(*motion)
        if seen.laid is not None:
            self.keyframes.constrain(seen.laid)
        hints = np.full(seen.rows.ranges_m.size, -1, dtype=np.int64)
        confidence = Confidence(self.joint.scans - self._monitor.scans + self._monitor.settled_before)
        self.joint.observe(seen.rows, hints, seen.sight, confidence, begins=first)
        if seen.laid is not None:
            self.keyframes.keep(seen.laid)
        self._moved = before.inverse() @ self.joint.map_from_body
        self._monitor.add(seen.stamp_ns, self.joint.evidence, seen.seen_before_share)

    def as_moved(self, seen: ScanSeen) -> ScanSeen:
        """The last scan with the motion that this map has: walls know better than wheels how the rover has turned."""
        return replace(seen, increment_mean=self._moved.as_array())

    @property
    def is_spoilt(self) -> bool:
        """Whether it does not fit what is seen any more: the rover was carried again."""
        return self._monitor.map_is_kept
