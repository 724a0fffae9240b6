"""Landmarks as visualization_msgs/MarkerArray."""

from typing import Any

import numpy as np

from runtime.messages.definitions import construct, serialize
from runtime.messages.map_json import existence
from runtime.messages.ros import header, ros_pose
from runtime.ros2.vehicle import PLAIN, Frames
from slam.estimate import LandmarkMap
from slam.pose import Pose2

MARKERS = "visualization_msgs/msg/MarkerArray"
SPHERE_LIST = 7  # visualization_msgs/Marker
NO_BYTES = np.empty(0, np.uint8)


def landmark_bytes(landmarks: LandmarkMap, wall_ns: int, frames: Frames = PLAIN) -> bytes:
    """visualization_msgs/MarkerArray: one list of spheres, red where existence is doubted, green where it is sure."""
    sure = existence(landmarks.existence_log_odds)
    marker = construct(
        "visualization_msgs/msg/Marker",
        header=header(wall_ns, frames("map")),
        ns="landmarks",
        id=0,
        type=SPHERE_LIST,
        action=0,
        pose=ros_pose(Pose2()),
        scale=construct("geometry_msgs/msg/Vector3", x=0.3, y=0.3, z=0.3),
        color=_color(0.0, 1.0, 0.0),
        lifetime=construct("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[construct("geometry_msgs/msg/Point", x=x, y=y, z=0.0) for x, y in landmarks.means_m.tolist()],
        colors=[_color(1.0 - p, p, 0.1) for p in sure.tolist()],
        texture_resource="",
        texture=construct("sensor_msgs/msg/CompressedImage", header=header(0, ""), format="", data=NO_BYTES),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=construct("visualization_msgs/msg/MeshFile", filename="", data=NO_BYTES),
        mesh_use_embedded_materials=False,
    )
    return serialize(MARKERS, construct(MARKERS, markers=[marker]))


def _color(red: float, green: float, blue: float) -> Any:
    return construct("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0)
