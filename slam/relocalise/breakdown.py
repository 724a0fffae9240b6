"""Whether the numbers that the filter goes on with are numbers still. Once one is not, every step after it fails."""

from dataclasses import dataclass, field

import numpy as np

from slam.estimate import Quality, Recognition
from slam.joint.evidence import SETTLED_SCANS
from slam.joint.gaussian import JointGaussian
from slam.joint.state import JointState
from slam.particles.fastslam import FastSlam
from slam.pose import Pose2
from slam.quality import Judgement, QualityMonitor

LARGEST = 1e15
"""Of a coordinate or a variance: no drive comes near, and squares of it do not overflow yet."""
POSE_ROWS = 6  # of the joint covariance: pose and constants of the odometry, which every step goes through


class BrokenFilterError(ArithmeticError):
    """A number of the filter is none any more; it has been begun anew. The message says which."""


@dataclass(slots=True)
class Breakdown:
    """What is told of the last one. sound_pose: map_from_body when all were numbers; times: how often one was none."""

    sound_pose: Pose2 = field(default_factory=Pose2)
    times: int = 0
    _doubt: str = ""
    _until_scan: int = 0
    _recognition: Recognition | None = None

    def note(self, cause: str, scans: int, recognition: Recognition | None) -> None:
        """After so many scans. recognition: of the new map, where one was begun."""
        self.times += 1
        if recognition is not None:
            self._doubt = f"the filter broke down: {cause}; a new map was begun"
            self._until_scan, self._recognition = scans + SETTLED_SCANS, recognition

    def judged(self, judgement: Judgement, scans: int) -> Judgement:
        """Until the new map has settled, nobody knows where in the old one the rover is."""
        return Judgement(Quality.LOST, self._doubt) if scans < self._until_scan else judgement

    def take_recognition(self) -> Recognition | None:
        """That of the new map, once."""
        recognition, self._recognition = self._recognition, None
        return recognition


def broken(joint: JointGaussian, particles: FastSlam, quality: QualityMonitor) -> str:
    """What is no number in the filter, "" where all is well."""
    score = "the score of the quality is not finite" if quality.is_broken else ""
    return broken_map(joint) or _broken_particles(particles) or score


def broken_map(joint: JointGaussian) -> str:
    """What is no number in a joint Gaussian, "" where all is well."""
    if is_broken(joint.state):
        return "the pose or a landmark of the joint Gaussian is not finite"
    return "" if np.isfinite(joint.after_miss).all() else "the detection rates of the joint Gaussian are not finite"


def is_broken(state: JointState) -> bool:
    """Whether the joint Gaussian cannot go on from here."""
    n = state.size
    parts = (state.mean[:n], state.covariance[:POSE_ROWS, :n], np.diagonal(state.covariance)[:n])
    return not all((np.abs(part) < LARGEST).all() for part in parts)  # false for NaN


def _broken_particles(particles: FastSlam) -> str:
    """What is no number in the particles, "" where all is well."""
    if not ((np.abs(particles.poses) < LARGEST).all() and (np.abs(particles.weighted_poses) < LARGEST).all()):
        return "the pose of a particle is not finite"
    sound = np.isfinite(particles.weights).all() and np.isfinite(particles.log_weights).all()
    return "" if sound else "the weight of a particle is not finite"
