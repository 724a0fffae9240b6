"""What is around a rover that is in doubt becomes a map of its own, with which it is looked for elsewhere."""

from itertools import pairwise

import numpy as np

from slam.front_end.deskew import Twist, deskew
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.observations import NO_FEATURES
from slam.pose import Pose2, wrap_rad
from slam.quality import QualityMonitor
from slam.recognise.local_points import local_points
from slam.recognise.scale import Scale
from slam.relocalise.local_map import LocalMap, ScanSeen
from slam.settings.joint import JointSettings
from slam.settings.quality import QualitySettings
from slam.settings.slam import SlamSettings
from slam.visibility import NO_SIGHT
from tests.slam.joint.test_gaussian import RING, STEP_NOISE, TUNING, features_at, look, seen_from
from tests.support.slam.corridor import drive_round


def test_what_is_seen_again_and_again_can_be_looked_for() -> None:
    """None was ever matched: a rover that had slipped did not find back by what stood around it."""
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, RING, 5)
    joint.predict(np.zeros(3), np.zeros((3, 3)))
    joint.scans += 1
    made = JointGaussian(JointSettings(), Pose2(), TUNING)
    local = LocalMap(made, Keyframes(made, Pose2()), QualityMonitor(QualitySettings()), joint, 0)
    step, pose = np.array((0.2, 0.0, 0.02)), Pose2()
    for number in range(8):
        if number:
            pose = pose @ Pose2(*step.tolist())
        rows = features_at(seen_from(pose, RING))
        rows = rows._replace(may_create=np.full(len(RING), number == 7))  # as later scans say of what moved
        local.follow(ScanSeen(number, step, STEP_NOISE, rows, NO_SIGHT, None), first=number == 0)
    assert len(local_points(local.joint.state, Scale(0.2))) == len(RING) == local.joint.landmark_count


def test_walls_hold_the_heading_of_a_rover_that_looks_for_its_place() -> None:
    """By its wheels alone, what it has seen is turned by degrees in metres, and lies nowhere."""
    stops, mount = drive_round(1, 0.15, Pose2(0.1, 0.0, 0.0)), Pose2(0.1, 0.0, 0.0)
    joint, tuning = JointGaussian(JointSettings(), mount, TUNING), SlamSettings().tuning()
    made = JointGaussian(JointSettings(), mount, tuning)
    local = LocalMap(made, Keyframes(made, mount), QualityMonitor(QualitySettings()), joint, 0)
    noise = np.diag(np.square((0.05, 0.05, 0.05)))
    followed = turned_rad = 0.0
    for number, (before, stop) in enumerate(pairwise(stops)):
        step = (before.map_from_body.inverse() @ stop.map_from_body).as_array()
        step[2] += 0.02
        beams = deskew(stop.scan, Twist(), mount, 0.1, 20.0)
        seen = ScanSeen(number, step, noise, NO_FEATURES, NO_SIGHT, None, laid=beams)
        local.follow(seen, first=number == 0)
        followed, turned_rad = followed + local.as_moved(seen).increment_mean[2], turned_rad + step[2]
    true_rad = wrap_rad(stops[-1].map_from_body.heading_rad - stops[1].map_from_body.heading_rad)
    assert abs(wrap_rad(turned_rad - true_rad)) > 0.25
    assert abs(wrap_rad(local.joint.map_from_body.heading_rad - true_rad)) < 0.05
    assert abs(wrap_rad(followed - true_rad)) < 0.05
