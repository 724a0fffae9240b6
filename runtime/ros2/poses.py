"""Pose, path and particles as geometry_msgs and nav_msgs have them, in the frame map."""

from collections.abc import Iterable

from drivers.measurements import FloatArray
from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import header, pose_with_covariance, ros_pose
from runtime.ros2.vehicle import PLAIN, Frames
from slam.estimate import Estimate
from slam.pose import Pose2

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSES = "geometry_msgs/msg/PoseArray"
STAMPED = "geometry_msgs/msg/PoseStamped"
PATH = "nav_msgs/msg/Path"
PATH_SPACING_M = 0.1
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
    poses = [ros_pose(Pose2(*row)) for row in particles.tolist()]
    return serialize(POSES, construct(POSES, header=header(stamp_ns, frames("map")), poses=poses))


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
        poses = list(_stamped(self._poses, frames("map")))
        return serialize(PATH, construct(PATH, header=header(stamp_ns, frames("map")), poses=poses))


def _stamped(poses: Iterable[tuple[int, Pose2]], frame: str) -> Iterable[object]:
    return (construct(STAMPED, header=header(stamp_ns, frame), pose=ros_pose(pose)) for stamp_ns, pose in poses)
