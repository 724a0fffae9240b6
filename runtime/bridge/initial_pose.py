"""/initialpose, as RViz and nav2 send it, as the words of the rover's command initial_pose."""

import math
from typing import Any

import numpy as np

from runtime.bridge.topics import BridgedTopic
from runtime.commands import parse_prior
from runtime.ros2.poses import POSE
from runtime.ros2.vehicle import Frames

INITIAL_POSE = BridgedTopic("initial_pose", "/initialpose", POSE)
OFF_UNIT = 0.01  # as tf2 allows; of a quaternion of another length, such as all zeros, the yaw would be wrong
MAP_FRAMES = ("", "map")  # RViz sends the fixed frame that it shows; nodes without a prefix know the map by this name


def words_of(message: Any, frames: Frames) -> str:
    """X,Y,YAW,SIGMA_M,SIGMA_RAD of a PoseWithCovarianceStamped; without the last two where its covariance is zero.

    sigma_m: of the larger axis of the ellipse. Raises ValueError with a sentence: another frame, numbers that make no
    sense.
    """
    frame = str(message.header.frame_id).lstrip("/")
    if frame not in (*MAP_FRAMES, frames("map")):
        raise ValueError(f"is in the frame {frame!r}, expected {frames('map')!r}; set the fixed frame of RViz to it")
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    length_squared = turn.x * turn.x + turn.y * turn.y + turn.z * turn.z + turn.w * turn.w
    if not abs(length_squared - 1.0) < OFF_UNIT:
        raise ValueError(f"has a quaternion whose length squared is {length_squared:.3g}, expected 1; normalise it")
    yaw_rad = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z))
    covariance = np.array(message.pose.covariance, dtype=np.float64).reshape(6, 6)
    words = [at.x, at.y, yaw_rad]
    if covariance.any() and np.isfinite(covariance).all():
        largest = float(np.linalg.eigvalsh(covariance[:2, :2])[-1])
        words += [math.sqrt(max(largest, 0.0)), math.sqrt(max(float(covariance[5, 5]), 0.0))]
    text = ",".join(f"{word:.9g}" for word in words)
    parse_prior(text)
    return text
