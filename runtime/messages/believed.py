"""Numbers of a message that anyone may have written, which are computed with."""

import math
from typing import Any

from slam.pose import Pose2

FAR_NS = 1 << 62  # a stamp that no clock of a rover shows; the sum of two is an int64


def pose_of(array: Any) -> Pose2:
    """x, y in m and heading in rad, array (3,). Raises ValueError where one of them is no number."""
    values = array.tolist()
    if not all(map(math.isfinite, values)):
        raise ValueError(f"a pose of {values}")
    return Pose2(*values)


def stamp_of(stamp_ns: int) -> int:
    """A stamp in ns. Raises ValueError where it is so far that it cannot be added to others."""
    if not -FAR_NS < stamp_ns < FAR_NS:
        raise ValueError(f"a stamp of {stamp_ns} ns")
    return stamp_ns
