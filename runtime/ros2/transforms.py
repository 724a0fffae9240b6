"""The tree map > odom > base_link > laser of REP 105: the correction is map to odom, and odom never jumps."""

import math
from typing import Any

from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import header, ros_pose
from runtime.ros2.vehicle import PLAIN, Frames, Vehicle
from slam.pose import Pose2

TF = "tf2_msgs/msg/TFMessage"


def transform_bytes(stamp_ns: int, map_from_body: Pose2, odom_from_body: Pose2, frames: Frames = PLAIN) -> bytes:
    """map to odom carries the correction, odom to base_link the dead reckoning."""
    correction = map_from_body @ odom_from_body.inverse()
    return transforms_bytes(
        planar_transform(stamp_ns, frames("map"), frames("odom"), correction),
        planar_transform(stamp_ns, frames("odom"), frames("base_link"), odom_from_body),
    )


def static_bytes(stamp_ns: int, vehicle: Vehicle) -> bytes:
    """base_link to laser from the mount; one that hangs upside down is rolled by half a turn."""
    mount, frames = vehicle.mount, vehicle.frames
    rotation = ros_pose(mount.as_pose()).orientation
    if mount.upside_down:
        half_rad = 0.5 * mount.yaw_rad
        x, y = math.cos(half_rad), math.sin(half_rad)
        rotation = construct("geometry_msgs/msg/Quaternion", x=x, y=y, z=0.0, w=0.0)
    return transforms_bytes(_transform(stamp_ns, frames("base_link"), frames("laser"), mount.as_pose(), rotation))


def planar_transform(stamp_ns: int, parent: str, child: str, parent_from_child: Pose2) -> Any:
    """geometry_msgs/TransformStamped of a planar pose."""
    return _transform(stamp_ns, parent, child, parent_from_child, ros_pose(parent_from_child).orientation)


def transforms_bytes(*transforms: Any) -> bytes:
    """tf2_msgs/TFMessage of them."""
    return serialize(TF, construct(TF, transforms=list(transforms)))


def _transform(stamp_ns: int, parent: str, child: str, pose: Pose2, rotation: Any) -> Any:
    translation = construct("geometry_msgs/msg/Vector3", x=pose.x_m, y=pose.y_m, z=0.0)
    return construct(
        "geometry_msgs/msg/TransformStamped",
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=construct("geometry_msgs/msg/Transform", translation=translation, rotation=rotation),
    )
