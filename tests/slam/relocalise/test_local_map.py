"""What is around a rover that is in doubt becomes a map of its own, with which it is looked for elsewhere."""

import numpy as np

from slam.joint.gaussian import JointGaussian
from slam.pose import Pose2
from slam.quality import QualityMonitor
from slam.recognise.local_points import local_points
from slam.recognise.scale import Scale
from slam.relocalise.local_map import LocalMap, ScanSeen
from slam.settings.joint import JointSettings
from slam.settings.quality import QualitySettings
from slam.visibility import NO_SIGHT
from tests.slam.joint.test_gaussian import RING, STEP_NOISE, TUNING, features_at, look, seen_from


def test_what_is_seen_again_and_again_can_be_looked_for() -> None:
    """None was ever matched: a rover that had slipped did not find back by what stood around it."""
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, RING, 5)
    joint.predict(np.zeros(3), np.zeros((3, 3)))
    joint.scans += 1
    local = LocalMap(JointGaussian(JointSettings(), Pose2(), TUNING), QualityMonitor(QualitySettings()), joint, 0)
    step, pose = np.array((0.2, 0.0, 0.02)), Pose2()
    for number in range(8):
        if number:
            pose = pose @ Pose2(*step.tolist())
        rows = features_at(seen_from(pose, RING))
        rows = rows._replace(may_create=np.full(len(RING), number == 7))  # as later scans say of what moved
        local.follow(ScanSeen(number, step, STEP_NOISE, rows, NO_SIGHT, None), first=number == 0)
    assert len(local_points(local.joint.state, Scale(0.2))) == len(RING) == local.joint.landmark_count
