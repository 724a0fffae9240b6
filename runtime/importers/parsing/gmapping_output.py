"""Logs that GMapping wrote: corrected poses, from which the motion that the wheels told can be won back.

After each scan GMapping writes an ODOM line that repeats the scan's corrected pose, with a stamp that means nothing,
and goes on from that pose: the steps between two lines are the wheels' own, the pose that they start from is not.
"""

from collections.abc import Sequence
from dataclasses import replace

from runtime.importers.parsing.carmen_lines import LaserLine
from slam.pose import Pose2

MARK = "NEFF"  # the number of effective particles, which nobody else logs
Item = LaserLine | list[float]


def wheels_own_motion(items: Sequence[Item]) -> list[Item | None]:
    """The same lines in the order of writing, None for a repeat, with odometry that goes on over the corrections.

    A scan keeps its corrected pose as that of the laser and gets the odometry's as that of the robot. Where scans are
    more than odometry lines, nothing tells of the wheels, and all poses stay as they are.
    """
    told = own = Pose2(0.0, 0.0, 0.0)
    turned: list[Item | None] = []
    before: Item | None = None
    for item in items:
        if isinstance(item, LaserLine):
            told = Pose2(*item.robot_pose) if item.robot_pose else told
            turned.append(replace(item, robot_pose=[own.x_m, own.y_m, own.heading_rad]))
        elif isinstance(before, LaserLine) and before.robot_pose == item:
            turned.append(None)
        else:
            pose = Pose2(*item)
            own, told = own @ (told.inverse() @ pose), pose
            turned.append([own.x_m, own.y_m, own.heading_rad])
        before = item
    scans = sum(isinstance(item, LaserLine) for item in turned)
    if 2 * scans > sum(item is not None for item in turned):
        return [None if again is None else item for item, again in zip(items, turned, strict=True)]
    return turned
