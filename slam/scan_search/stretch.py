"""The scans of the last metres, as the rover sees them from where it is."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.pose import Pose2

LENGTH_M = 3.0  # of the way, after which there is enough to look for; a radian counts as a metre
STEP_M, STEP_RAD = 0.3, 0.2  # the rover moves or turns so far before another scan is kept
MOST_SCANS = 40
THIN_M = 0.2  # of returns nearer to each other one is kept
MOST_POINTS = 400

PointArray = NDArray[np.float32]
NO_POINTS: PointArray = np.zeros((0, 2), dtype=np.float32)


class Stretch:
    """frame_from_body: dead reckoning since the beginning."""

    def __init__(self) -> None:
        self.frame_from_body = Pose2()
        self._since = math.inf  # so that the first scan is looked for by itself
        self._kept: list[tuple[Pose2, PointArray]] = []

    def add(self, increment: FloatArray, points_m: PointArray) -> None:
        """A motion (3,), and the returns (p, 2), body frame, after it."""
        self.frame_from_body = pose = self.frame_from_body @ Pose2(*increment.tolist())
        self._since += math.hypot(*increment[:2].tolist()) + abs(float(increment[2]))
        if not len(points_m):
            return
        if self._kept:
            off = self._kept[-1][0].inverse() @ pose
            if math.hypot(off.x_m, off.y_m) < STEP_M and abs(off.heading_rad) < STEP_RAD:
                return
        self._kept = [*self._kept[1 - MOST_SCANS :], (pose, points_m)]

    @property
    def is_due(self) -> bool:
        """Whether there is enough that was not taken yet."""
        return self._since >= LENGTH_M and len(self._kept) > 0

    def take(self) -> FloatArray:
        """(n, 2) what was seen since the last time, in the frame of the body as it stands now."""
        body_from_frame = self.frame_from_body.inverse()
        seen = [(body_from_frame @ pose).transform(points.astype(np.float64)) for pose, points in self._kept]
        self._kept, self._since = [], 0.0
        cells = np.unique(np.floor(np.vstack(seen) / THIN_M), axis=0)
        points = THIN_M * (cells + 0.5)
        return points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(np.int64)]
