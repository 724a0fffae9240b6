import math

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.joint.gaussian import JointGaussian
from slam.keyframes.far_loops import FarLoops
from slam.keyframes.keyframes import Keyframes
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from tests.support.slam.corridor import Stop, drive_round
from tests.support.slam.wide import AT_A_CORNER, MOUNT, beams_of, scan_at, search_between

WHEELS = np.diag((0.02, 0.02, 0.004)) ** 2


@pytest.mark.parametrize(("off", "sigma_m"), [((1.5, -0.8, 0.04), 1.5), ((5.0, -3.0, 0.04), 4.0)])
def test_a_loop_is_closed_where_the_pose_is_known_to_metres_only(
    off: tuple[float, float, float], sigma_m: float
) -> None:
    """A lap, metres of drift told honestly, and the same corridor again: the way back is found by two keyframes."""
    stops = drive_round(1, 1.7, MOUNT)
    lap = next(
        i
        for i, stop in enumerate(stops)
        if i > 60 and math.hypot(stop.map_from_body.x_m - 8, stop.map_from_body.y_m) < 0.6
    )
    joint = JointGaussian(JointSettings(), MOUNT, SlamSettings().tuning())
    keyframes, before, errors = Keyframes(joint, MOUNT), stops[0].map_from_body, []
    for number, stop in enumerate(stops):
        moved = before.inverse() @ stop.map_from_body
        drift, unknown = (np.array(off), np.diag((sigma_m, sigma_m, 0.05)) ** 2) if number == lap else (0.0, 0.0)
        joint.predict(moved.as_array() + drift, WHEELS + unknown)
        keyframes.constrain(beams_of(stop.scan))
        keyframes.keep(beams_of(stop.scan))
        before = stop.map_from_body
        errors.append(error_of(joint, stops[0], stop))
    assert math.hypot(*errors[lap][:2]) > 0.9 * math.hypot(*off[:2])
    assert math.hypot(*errors[-1][:2]) < 0.3
    assert math.sqrt(joint.covariance[:2, :2].trace()) < 0.3
    assert keyframes.figures["loops_closed"] > 0


KEYFRAMES = (AT_A_CORNER, AT_A_CORNER @ Pose2(-1.0, -0.2, 0.1))  # where they stand in truth
OFF = Pose2(1.2, -0.7, 0.05)  # how the pose has drifted, in the map
SEEN_FROM = (AT_A_CORNER @ Pose2(-1.5, 0.0, 0.1), AT_A_CORNER @ Pose2(-0.6, 0.1, 0.0))


def tried(loops: FarLoops, keyframe: int, at: Pose2, off: Pose2 = OFF, sigma_m: float = 0.015) -> bool:
    """Whether a keyframe is believed by a rover at a true pose who takes itself to be off from there."""
    search = search_between(scan_at(KEYFRAMES[keyframe], 1), scan_at(at, 2, sigma_m=sigma_m))
    pose = off @ at
    predicted = (KEYFRAMES[keyframe].inverse() @ pose).as_array()
    return loops.find(keyframe, search, predicted, pose, predicted) is not None


def test_two_keyframes_that_say_the_same_are_believed_and_one_alone_is_not() -> None:
    loops = FarLoops()
    assert not tried(loops, 0, SEEN_FROM[0])
    assert not tried(loops, 0, SEEN_FROM[1])
    assert tried(loops, 1, SEEN_FROM[1])
    assert not tried(loops, 0, SEEN_FROM[1])  # the correction is asked for anew


def test_two_keyframes_that_contradict_each_other_are_not_believed() -> None:
    loops = FarLoops()
    assert not tried(loops, 0, SEEN_FROM[0])
    assert not tried(loops, 1, SEEN_FROM[1], Pose2(1.2, -0.2, 0.05))


def test_scans_that_lie_beside_the_surfaces_are_not_believed() -> None:
    """As near as things coincide, and not on the walls: what looks alike a few metres on is such a place."""
    loops = FarLoops()
    assert not tried(loops, 0, SEEN_FROM[0], sigma_m=0.25)
    assert not tried(loops, 1, SEEN_FROM[1], sigma_m=0.25)


def error_of(joint: JointGaussian, first: Stop, now: Stop) -> FloatArray:
    true = first.map_from_body.inverse() @ now.map_from_body
    return (true.inverse() @ joint.map_from_body).as_array()
