"""Dead reckoning as nav_msgs/Odometry: pose in the frame odom, twist in the body's, both with honest covariances."""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import header, planar_covariance, ros_pose
from runtime.ros2.vehicle import PLAIN, Frames
from slam.estimate import Estimate
from slam.pose import Pose2
from slam.settings.odometry import OdometrySettings

ODOMETRY = "nav_msgs/msg/Odometry"
UNKNOWN = 1e6  # m^2, rad^2 or their rates: nothing is known; a minus one would be taken for a variance
FASTEST_MPS, FASTEST_RADPS = 3.0, 2.0  # of a rover whose wheels were silent
LONGEST_S = 1.0  # between two estimates; beyond it a mean velocity says nothing of now
LEAST_MPS, LEAST_RADPS = 0.002, 0.002  # no encoder knows a speed better within a tick of 0.1 s: half a millimetre
ERRORS = 6  # x, y, heading, and three that stay the same in a drive: travel, its difference left and right, tread


@dataclass(frozen=True, slots=True, eq=False)
class Dead:
    """Dead reckoning at one time: odom_from_body with its covariance (3, 3), and the twist (3,) with its own."""

    odom_from_body: Pose2
    covariance: FloatArray
    twist: FloatArray
    twist_covariance: FloatArray


class OdometryTrack:
    """Adds up, estimate by estimate and to first order, how far dead reckoning can be off by [slam.odometry].

    Slip is a random walk; errors of wheel radii and tread are constants, so that their share grows with the distance.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._last: tuple[int, Pose2] | None = None
        self._covariance = np.zeros((ERRORS, ERRORS))
        ratio, tread = settings.radius_uncertainty, settings.tread_uncertainty
        wheels = settings.model == "differential"
        self._covariance[3, 3] = ratio**2 / 2.0 if wheels else 0.0
        self._covariance[4, 4] = 2.0 * (ratio / settings.tread_m) ** 2 if wheels else 0.0
        self._covariance[5, 5] = tread**2 if wheels else 0.0

    def take(self, estimate: Estimate) -> Dead:
        """The next estimate; one that is not later than the last leaves the twist unknown."""
        stamp_ns, pose = estimate.stamp_ns, estimate.odom_from_body
        last, self._last = self._last, (stamp_ns, pose)
        twist, twist_covariance = np.zeros(3), np.eye(3) * UNKNOWN
        if last is not None and stamp_ns > last[0]:
            duration_s, step = (stamp_ns - last[0]) * 1e-9, last[1].inverse() @ pose
            noise = self._noise(step, duration_s, estimate.counts.get("odometry_known", 1.0) > 0.0)
            self._grow(last[1].heading_rad, step, noise)
            if duration_s <= LONGEST_S:
                twist = step.as_array() / duration_s
                twist_covariance = noise / duration_s**2
                twist_covariance += np.diag((LEAST_MPS, LEAST_MPS, LEAST_RADPS)) ** 2
        return Dead(pose, self._covariance[:3, :3].copy(), twist, twist_covariance)

    def _noise(self, step: Pose2, duration_s: float, known: bool) -> FloatArray:
        """Covariance (3, 3) of one step in the body frame, the constant errors left out."""
        settings = self._settings
        if not known:
            return np.diag((FASTEST_MPS, FASTEST_MPS, FASTEST_RADPS)) ** 2 * duration_s**2
        distance_m, turn_rad = math.hypot(step.x_m, step.y_m), abs(step.heading_rad)
        forward, turned = settings.slip_m_per_sqrt_m**2 * distance_m, settings.heading_rad_per_sqrt_m**2 * distance_m
        match settings.model:
            case "differential":
                forward, rolled = 0.5 * forward, distance_m + 0.5 * settings.tread_m * turn_rad
                turned += 2.0 * settings.slip_m_per_sqrt_m**2 * rolled / settings.tread_m**2
            case "pose":
                turned += settings.heading_rad_per_sqrt_rad**2 * turn_rad
            case model if distance_m > 0.0:
                lasting_s = duration_s * settings.noise_time_s
                speed_mps = distance_m / duration_s
                forward += (settings.speed_noise_mps**2 + (settings.speed_noise_ratio * speed_mps) ** 2) * lasting_s
                yaw_radps = settings.yaw_rate_noise_radps
                if model == "steered":
                    yaw_radps = speed_mps * settings.steering_noise_rad / settings.wheel_base_m
                turned += yaw_radps**2 * lasting_s
        return np.diag((forward, settings.lateral_m_per_sqrt_m**2 * distance_m, turned))

    def _grow(self, heading_rad: float, step: Pose2, noise: FloatArray) -> None:
        """Carry the covariance over one step: errors = forward @ errors + turned noise."""
        cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
        turned = np.array(((cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)))
        moved = turned @ step.as_array()
        forward = np.eye(ERRORS)
        forward[0, 2], forward[1, 2] = -moved[1], moved[0]
        forward[:3, 3] = (moved[0], moved[1], 0.0)
        forward[2, 4], forward[2, 5] = step.x_m, step.heading_rad
        grown = forward @ self._covariance @ forward.T
        grown[:3, :3] += turned @ noise @ turned.T
        self._covariance = 0.5 * (grown + grown.T)


def odometry_bytes(stamp_ns: int, dead: Dead, frames: Frames = PLAIN) -> bytes:
    """The message; stamp_ns is wall time."""
    speed, lateral, yaw_rate = dead.twist.tolist()
    linear = construct("geometry_msgs/msg/Vector3", x=speed, y=lateral, z=0.0)
    angular = construct("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=yaw_rate)
    message = construct(
        ODOMETRY,
        header=header(stamp_ns, frames("odom")),
        child_frame_id=frames("base_link"),
        pose=construct(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=ros_pose(dead.odom_from_body),
            covariance=planar_covariance(dead.covariance),
        ),
        twist=construct(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=construct("geometry_msgs/msg/Twist", linear=linear, angular=angular),
            covariance=planar_covariance(dead.twist_covariance),
        ),
    )
    return serialize(ODOMETRY, message)
