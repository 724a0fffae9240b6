"""A drive among trees at feature level: the joint Gaussian, its quality and the way back, without particles."""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.estimate import Recognition
from slam.joint.evidence import Confidence
from slam.joint.gaussian import JointGaussian
from slam.observations import Features, usable_rows
from slam.pose import Pose2
from slam.quality import QualityMonitor
from slam.relocalise.local_map import ScanSeen
from slam.relocalise.relocaliser import Relocaliser
from slam.settings.slam import SlamSettings
from slam.visibility import field_of_view

SIGMA_M, SIGMA_RAD = 0.05, 0.005
STEP_M = 0.5
STEP_NS = 250_000_000
STEP_NOISE = np.diag((0.03**2, 0.01**2, 0.01**2))
VIEW_M = 20.0
SIGHT = field_of_view(VIEW_M - 2.0, math.pi)
SETTINGS = SlamSettings.model_validate(
    {
        "front_end": {"sigma_range_m": 0.1},
        "view": {"range_max_m": VIEW_M},
    }
)


def joint_gaussian() -> JointGaussian:
    return JointGaussian(SETTINGS.joint, Pose2(), SETTINGS.tuning())


class TreeDrive:
    """Begins at the origin of trees_m (N, 2), which are seen in all directions up to VIEW_M.

    map_from_world: the frame of the map that the pose is in, where nothing went wrong.
    """

    def __init__(self, seed: int, trees_m: FloatArray) -> None:
        self._generator = np.random.default_rng(seed)
        self._trees_m = trees_m
        self.truth = Pose2()
        self.joint = joint_gaussian()
        self.quality = QualityMonitor(SETTINGS.quality)
        self.relocaliser = Relocaliser(SETTINGS, self.joint)
        self.recognitions: list[Recognition] = []
        self._stamp_ns = 0

    def step(self, turn_rad: float = 0.0, ahead_m: float = STEP_M, carried: Pose2 | None = None) -> None:
        """Drive on and look around. carried: what the wheels do not know of."""
        self._stamp_ns += STEP_NS
        moved = np.array((ahead_m, 0.0, turn_rad))
        self.truth = self.truth @ Pose2(*moved.tolist()) @ (carried or Pose2())
        noise = STEP_NOISE if ahead_m else np.zeros((3, 3))
        told = moved + np.sqrt(np.diag(noise)) * self._generator.standard_normal(3)
        self.joint.predict(told, noise)
        rows = usable_rows(self._features(), VIEW_M, 0.0)
        confidence = Confidence(self.quality.settled_before, self.quality.map_is_kept)
        hints: IntArray = np.full(rows.ranges_m.size, -1)
        matched = self.joint.observe(rows, hints, SIGHT, confidence)
        self.quality.add(self._stamp_ns, self.joint.evidence)
        seen = ScanSeen(self._stamp_ns, told, noise, rows, SIGHT, None)
        recognition = self.relocaliser.step(seen, matched, self.quality)
        if recognition is not None:
            self.recognitions.append(recognition)
            self.joint = self.relocaliser.here.joint

    def straight(self, steps: int) -> None:
        for _ in range(steps):
            self.step()

    def circle(self, steps: int, radius_m: float) -> None:
        for _ in range(steps):
            self.step(STEP_M / radius_m)

    def error_m(self) -> float:
        """How far the pose is from the truth, in a map that begins where the drive began."""
        pose = self.joint.map_from_body
        return math.hypot(pose.x_m - self.truth.x_m, pose.y_m - self.truth.y_m)

    def _features(self) -> Features:
        points = self.truth.inverse().transform(self._trees_m)
        points = points[np.hypot(*points.T) < VIEW_M]
        count = len(points)
        noise = self._generator.standard_normal((count, 2)) * (SIGMA_M, SIGMA_RAD)
        return Features(
            self._stamp_ns,
            np.hypot(*points.T) + noise[:, 0],
            np.arctan2(points[:, 1], points[:, 0]) + noise[:, 1],
            np.tile(np.diag((SIGMA_M**2, SIGMA_RAD**2)), (count, 1, 1)),
            np.ones(count, dtype=np.bool_),
            np.full(count, -1, dtype=np.int64),
            np.full(count, -1, dtype=np.int64),
        )
