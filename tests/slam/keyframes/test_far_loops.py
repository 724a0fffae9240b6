import math

import numpy as np

from drivers.measurements import FloatArray
from slam.front_end.deskew import Beams, Twist, deskew
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from tests.support.slam.corridor import Stop, drive_round

MOUNT = Pose2(0.1, 0.0, 0.0)
WHEELS = np.diag((0.02, 0.02, 0.004)) ** 2
UNKNOWN = np.diag((1.5, 1.5, 0.05)) ** 2


def beams_of(stop: Stop) -> Beams:
    return deskew(stop.scan, Twist(), MOUNT, 0.1, 20.0)


def test_a_loop_is_closed_where_the_pose_is_known_to_metres_only() -> None:
    """A lap, metres of drift told honestly, and the same corridor again: the way back is found by two keyframes."""
    stops = drive_round(1, 1.3, MOUNT)
    lap = next(
        i
        for i, stop in enumerate(stops)
        if i > 60 and math.hypot(stop.map_from_body.x_m - 8, stop.map_from_body.y_m) < 0.6
    )
    joint = JointGaussian(JointSettings(), MOUNT, SlamSettings().tuning())
    keyframes, before, errors = Keyframes(joint, MOUNT), stops[0].map_from_body, []
    for number, stop in enumerate(stops):
        moved = before.inverse() @ stop.map_from_body
        drift = (1.5, -0.8, 0.04) if number == lap else (0.0, 0.0, 0.0)
        joint.predict(moved.as_array() + np.array(drift), WHEELS + (UNKNOWN if number == lap else 0.0))
        keyframes.constrain(beams_of(stop))
        keyframes.keep(beams_of(stop))
        before = stop.map_from_body
        errors.append(error_of(joint, stops[0], stop))
    assert math.hypot(*errors[lap][:2]) > 1.4
    assert math.hypot(*errors[-1][:2]) < 0.3
    assert math.sqrt(joint.covariance[:2, :2].trace()) < 0.3
    assert keyframes.closed > 0


def error_of(joint: JointGaussian, first: Stop, now: Stop) -> FloatArray:
    true = first.map_from_body.inverse() @ now.map_from_body
    return (true.inverse() @ joint.map_from_body).as_array()
