"""Whether two keyframes say the same of where the rover is: rooms look alike, and one alone may be another place."""

import math

from slam.pose import Pose2

SAME_M, SAME_RAD = 0.3, 0.1  # two fits that correct the pose so nearly alike say the same


class Agreement:
    """Remembers which keyframe spoke last, and how it would have the pose move.

    said_before: its number and the correction, in the map frame; None where none has spoken, or two have agreed.
    """

    def __init__(self) -> None:
        self.said_before: tuple[int, Pose2] | None = None

    def confirms(self, number: int, correction: Pose2, pose: Pose2) -> bool:
        """Whether another keyframe has said the same before, of a pose in the map; the correction is then due."""
        before, self.said_before = self.said_before, (number, correction)
        if before is None or before[0] == number:
            return False
        if not are_alike(before[1] @ pose, correction @ pose):
            return False
        self.said_before = None
        return True


def correction_of(pose: Pose2, predicted: Pose2, found: Pose2) -> Pose2:
    """What a pose in the map is to be moved by, from the left, where a keyframe sees the body at found and not where it
    was predicted.
    """
    return pose @ predicted.inverse() @ found @ pose.inverse()


def are_alike(one: Pose2, other: Pose2) -> bool:
    """Whether two poses are so near each other that they say the same."""
    apart = one.inverse() @ other
    return math.hypot(apart.x_m, apart.y_m) < SAME_M and abs(apart.heading_rad) < SAME_RAD
