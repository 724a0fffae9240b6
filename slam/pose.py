"""Planar poses, one or rows of them: composition, inverse, transforms of points, and the wrap of angles.

A Pose2 named map_from_body takes body coordinates to map coordinates; neighbours in a product match.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.elementary import cosine_sine


def wrap_rad(angle: float) -> float:
    """Angle in (-pi, pi]."""
    wrapped = math.fmod(angle + math.pi, 2.0 * math.pi)
    if wrapped <= 0.0:
        wrapped += 2.0 * math.pi
    return wrapped - math.pi


def wrap_rads(angles: FloatArray) -> FloatArray:
    """The same for an array of any shape."""
    wrapped = np.fmod(angles + np.pi, 2.0 * np.pi)
    return np.where(wrapped <= 0.0, wrapped + 2.0 * np.pi, wrapped) - np.pi


@dataclass(frozen=True, slots=True)
class Pose2:
    """Position in metres and heading in radians of one planar frame in another."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0

    def __matmul__(self, other: "Pose2") -> "Pose2":
        """Composition: a_from_b @ b_from_c is a_from_c."""
        cosine, sine = cosine_sine(self.heading_rad)
        return Pose2(
            self.x_m + cosine * other.x_m - sine * other.y_m,
            self.y_m + sine * other.x_m + cosine * other.y_m,
            wrap_rad(self.heading_rad + other.heading_rad),
        )

    def inverse(self) -> "Pose2":
        """a_from_b becomes b_from_a."""
        cosine, sine = cosine_sine(self.heading_rad)
        return Pose2(
            -cosine * self.x_m - sine * self.y_m,
            sine * self.x_m - cosine * self.y_m,
            wrap_rad(-self.heading_rad),
        )

    def transform(self, points_m: FloatArray) -> FloatArray:
        """Points (N, 2) of the inner frame in the outer frame."""
        cosine, sine = cosine_sine(self.heading_rad)
        x, y = points_m[..., 0], points_m[..., 1]
        return np.stack((self.x_m + cosine * x - sine * y, self.y_m + sine * x + cosine * y), axis=-1)

    def as_array(self) -> FloatArray:
        """(3,) x, y, heading."""
        return np.array((self.x_m, self.y_m, self.heading_rad))


def turning(angle: float) -> FloatArray:
    """(2, 2) that turns vectors counter-clockwise."""
    cosine, sine = cosine_sine(angle)
    return np.array(((cosine, -sine), (sine, cosine)))


def rotated(vectors: FloatArray, angles_rad: FloatArray | float) -> FloatArray:
    """Vectors (..., 2) turned counter-clockwise, all by one angle or each by its own (...)."""
    cosine, sine = np.cos(angles_rad), np.sin(angles_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)


def composed(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Row by row a_from_b @ b_from_c of poses (n, 3) or (3,); headings are not wrapped."""
    cosine, sine = np.cos(outer[..., 2]), np.sin(outer[..., 2])
    return np.stack(
        (
            outer[..., 0] + cosine * inner[..., 0] - sine * inner[..., 1],
            outer[..., 1] + sine * inner[..., 0] + cosine * inner[..., 1],
            outer[..., 2] + inner[..., 2],
        ),
        axis=-1,
    )


def inverted(poses: FloatArray) -> FloatArray:
    """Row by row a_from_b becomes b_from_a, (n, 3) or (3,); headings are not wrapped."""
    cosine, sine = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    x, y = poses[..., 0], poses[..., 1]
    return np.stack((-cosine * x - sine * y, sine * x - cosine * y, -poses[..., 2]), axis=-1)
