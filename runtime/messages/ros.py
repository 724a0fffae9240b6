"""The messages of a run that other tools read: standard ROS 2 types, stamped with the host's monotonic time."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import Event, Scan, Severity
from runtime.messages.definitions import construct
from runtime.messages.tick import Record, decode, encode
from slam.arithmetic.elementary import cosine_sine
from slam.estimate import Estimate
from slam.pose import Pose2

LEVELS = {Severity.INFO: 0, Severity.WARN: 1, Severity.ERROR: 2}  # DiagnosticStatus OK, WARN, ERROR
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8  # flags of RawTap.can_frame
PLANAR_BLOCK = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw
CDR_HEADER = b"\0\1\0\0"  # little-endian
CAN_FRAME = struct.Struct("<4siI8sI???B8s")  # can_msgs/Frame packed at once: a log has millions of them
CAN_ID = b"\4\0\0\0can\0"  # frame_id of its header
LAST_NS = (2**31 - 1) * 1_000_000_000 + 999_999_999  # seconds are an int32
QUIET = np.uint32(1 << 22)  # the bit of a float32 NaN that is not signalling
UNKNOWN_VARIANCE = 1e6  # m^2, rad^2: nothing is claimed. A minus one means that in sensor_msgs/Imu only


def header(stamp_ns: int, frame: str) -> Any:
    """std_msgs/Header; its seconds end with ROS's own in 2038."""
    seconds, nanoseconds = _stamp(stamp_ns)
    stamp = construct("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return construct("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def encode_scan(scan: Scan) -> Record:
    """The scan's ranges, float32 to the last bit; NaN where nothing valid came back."""
    bearings_rad, beams = scan.bearings_rad, scan.bearings_rad.size
    first_rad, last_rad = (float(bearings_rad[0]), float(bearings_rad[-1])) if beams else (0.0, 0.0)
    return encode(
        "/scan",
        scan.stamp_ns,
        header=header(scan.stamp_ns, "laser"),
        angle_min=first_rad,
        angle_max=last_rad,
        angle_increment=(last_rad - first_rad) / (beams - 1) if beams > 1 else 0.0,
        time_increment=scan.beam_period_s,
        scan_time=scan.beam_period_s * beams,
        range_min=0.0,
        range_max=scan.range_max_m,
        ranges=scan.ranges_m,
        intensities=np.empty(0, np.float32),
    )


def decode_ranges_m(data: bytes) -> NDArray[np.float32]:
    """Ranges (N,) of a record of /scan, in memory of their own."""
    ranges_m: NDArray[np.float32] = decode("/scan", data).ranges.copy()
    ranges_m.view(np.uint32)[np.isnan(ranges_m)] |= QUIET  # a signalling NaN of a stranger warns where it is widened
    return ranges_m


def encode_pose(estimate: Estimate) -> Record:
    """The published pose in the frame map."""
    return encode(
        "/pose",
        estimate.stamp_ns,
        header=header(estimate.stamp_ns, "map"),
        pose=pose_with_covariance(estimate.map_from_body, estimate.covariance),
    )


def encode_odometry(estimate: Estimate) -> Record:
    """Dead reckoning since the start in the frame odom; a record claims no more of it (ros2/odometry.py does)."""
    unknown = np.eye(6).ravel() * UNKNOWN_VARIANCE
    nothing = construct("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    twist = construct("geometry_msgs/msg/Twist", linear=nothing, angular=nothing)
    pose = construct(TYPES_POSE, pose=ros_pose(estimate.odom_from_body), covariance=unknown)
    return encode(
        "/odom",
        estimate.stamp_ns,
        header=header(estimate.stamp_ns, "odom"),
        child_frame_id="base_link",
        pose=pose,
        twist=construct("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )


TYPES_POSE = "geometry_msgs/msg/PoseWithCovariance"


def ros_pose(pose: Pose2) -> Any:
    """geometry_msgs/Pose of a planar pose."""
    w, z = cosine_sine(0.5 * pose.heading_rad)
    position = construct("geometry_msgs/msg/Point", x=pose.x_m, y=pose.y_m, z=0.0)
    turn = construct("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=z, w=w)
    return construct("geometry_msgs/msg/Pose", position=position, orientation=turn)


def pose_with_covariance(pose: Pose2, covariance: NDArray[np.float64]) -> Any:
    """The planar covariance (3, 3) in the rows x, y and yaw of ROS's (6, 6)."""
    return construct(TYPES_POSE, pose=ros_pose(pose), covariance=planar_covariance(covariance))


def planar_covariance(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(36,) of (3, 3) over x, y and yaw; z, roll and pitch of a rover on a plane are zero and have no variance."""
    full = np.zeros((6, 6))
    full[PLANAR_BLOCK] = covariance
    return full.ravel()


def encode_events(stamp_ns: int, events: Sequence[Event]) -> Record:
    """Events as diagnostics: source, kind as the hardware identity, reason as the message."""
    status = [
        construct(
            "diagnostic_msgs/msg/DiagnosticStatus",
            level=LEVELS[event.severity],
            name=event.source,
            message=event.reason,
            hardware_id=event.kind,
            values=[],
        )
        for event in events
    ]
    return encode("/diagnostics", stamp_ns, header=header(stamp_ns, ""), status=status)


def encode_can_frame(stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> Record:
    """One CAN frame; an FD frame, which can_msgs has no room for, goes to /raw/can_fd."""
    if flags & FD:
        return encode(
            "/raw/can_fd",
            stamp_ns,
            header=header(stamp_ns, "can"),
            id=arbitration_id,
            is_extended=bool(flags & EXTENDED),
            data=np.frombuffer(data, np.uint8),
        )
    kinds = (bool(flags & REMOTE), bool(flags & EXTENDED), bool(flags & ERROR))
    content = CAN_FRAME.pack(CDR_HEADER, *_stamp(stamp_ns), CAN_ID, arbitration_id, *kinds, len(data), data)
    return Record("/raw/can", stamp_ns, content)


def _stamp(stamp_ns: int) -> tuple[int, int]:
    """Seconds, floored so that nanoseconds are never negative, and nanoseconds."""
    return divmod(min(max(stamp_ns, -LAST_NS), LAST_NS), 1_000_000_000)
