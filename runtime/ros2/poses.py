"""Pose, path and particles as geometry_msgs and nav_msgs have them, in the frame map.

Path and particles are hundreds of poses a second: their bytes are laid out as arrays, message by message would take
a third of the time of an export.
"""

import struct

import numpy as np

from drivers.measurements import FloatArray
from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import LAST_NS, header, pose_with_covariance, ros_pose
from runtime.ros2.vehicle import PLAIN, Frames
from slam.estimate import Estimate
from slam.pose import Pose2

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSES = "geometry_msgs/msg/PoseArray"
STAMPED = "geometry_msgs/msg/PoseStamped"
PATH = "nav_msgs/msg/Path"
PATH_SPACING_M = 0.1
CDR_HEADER = b"\0\1\0\0"  # little-endian; what follows is aligned to where it ends
CDR_BYTES, STAMP_BYTES = 4, 8
MOST_PATH_POSES = 2000  # 150 kB; a longer path is thinned to half of them


def pose_bytes(stamp_ns: int, estimate: Estimate, frames: Frames = PLAIN) -> bytes:
    """The published pose."""
    pose = pose_with_covariance(estimate.map_from_body, estimate.covariance)
    return serialize(POSE, construct(POSE, header=header(stamp_ns, frames("map")), pose=pose))


def stamped_bytes(stamp_ns: int, map_from_body: Pose2, frames: Frames = PLAIN) -> bytes:
    """A pose without covariance, for the truth."""
    stamped = header(stamp_ns, frames("map"))
    return serialize(STAMPED, construct(STAMPED, header=stamped, pose=ros_pose(map_from_body)))


def particle_bytes(stamp_ns: int, particles: FloatArray, frames: Frames = PLAIN) -> bytes:
    """Poses (M, 3) of the particles; PoseArray has no weights."""
    head = _head(stamp_ns, frames("map"), len(particles))
    return head + (bytes(-(len(head) - CDR_BYTES) % 8) + _planar(particles).tobytes() if len(particles) else b"")


class DrivenPath:
    """The path so far, at most MOST_PATH_POSES of it: when there are more, every second one goes."""

    def __init__(self) -> None:
        self._poses: list[tuple[int, Pose2]] = []
        self._spacing_m = PATH_SPACING_M

    def add(self, stamp_ns: int, pose: Pose2) -> None:
        """A pose that counts where it is far enough from the one before."""
        if self._poses:
            last = self._poses[-1][1]
            if max(abs(pose.x_m - last.x_m), abs(pose.y_m - last.y_m)) < self._spacing_m:
                return
        self._poses.append((stamp_ns, pose))
        if len(self._poses) > MOST_PATH_POSES:
            self._poses = self._poses[::2]
            self._spacing_m *= 2.0

    def __len__(self) -> int:
        return len(self._poses)

    def as_bytes(self, stamp_ns: int, frames: Frames = PLAIN) -> bytes:
        """nav_msgs/Path."""
        head, frame = _head(stamp_ns, frames("map"), len(self._poses)), _text(frames("map"))
        stamps_ns = np.array([stamp_ns for stamp_ns, _ in self._poses], np.int64).clip(-LAST_NS, LAST_NS)
        seven = _planar(np.array([(pose.x_m, pose.y_m, pose.heading_rad) for _, pose in self._poses]).reshape(-1, 3))
        parts = [head]
        for part, begins in ((slice(0, 1), len(head) - CDR_BYTES), (slice(1, None), 0)):  # each ends on a multiple of 8
            gap = -(begins + STAMP_BYTES + len(frame)) % 8
            rows = np.zeros(
                len(stamps_ns[part]),
                [("s", "<i4"), ("ns", "<u4"), ("frame", f"S{len(frame)}"), ("gap", f"V{gap}"), ("pose", "<f8", 7)],
            )
            rows["s"], rows["ns"] = np.divmod(stamps_ns[part], 1_000_000_000)
            rows["frame"], rows["pose"] = frame, seven[part]
            parts.append(rows.tobytes())
        return b"".join(parts)


def _head(stamp_ns: int, frame: str, count: int) -> bytes:
    """CDR up to the first of `count` poses: the encapsulation, std_msgs/Header, the length of the sequence."""
    seconds, nanoseconds = divmod(min(max(stamp_ns, -LAST_NS), LAST_NS), 1_000_000_000)
    stamped = struct.pack("<iI", seconds, nanoseconds) + _text(frame)
    return CDR_HEADER + stamped + bytes(-len(stamped) % 4) + struct.pack("<I", count)


def _text(text: str) -> bytes:
    """A string of CDR, which ends with a zero that counts."""
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def _planar(poses: FloatArray) -> FloatArray:
    """Position and quaternion, (n, 7), of poses (n, 3)."""
    seven = np.zeros((len(poses), 7))
    seven[:, :2] = poses[:, :2]
    seven[:, 5], seven[:, 6] = np.sin(0.5 * poses[:, 2]), np.cos(0.5 * poses[:, 2])
    return seven
