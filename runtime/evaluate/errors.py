"""How far an estimated path is from the true one, given twice: in the frame of the start pose, and after the best fit.

The first says what a user of the pose gets; the second is the error of the shape of path and map, without the heading
that was lost at the very start.
"""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.pose import Pose2, wrap_rads

LEAST_FIT_POINTS = 3


@dataclass(frozen=True, slots=True)
class PositionError:
    """Metres: the largest, the root mean square, and that of the smallest 95 %."""

    largest_m: float
    rms_m: float
    trimmed_rms_m: float


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """Error in the frame of the start pose, and after the best rigid fit of the whole path."""

    from_start: PositionError
    aligned: PositionError


def in_start_frame(poses: FloatArray) -> FloatArray:
    """Poses (n, 3) as seen from the first one."""
    start = Pose2(*(float(value) for value in poses[0])).inverse()
    positions = start.transform(poses[:, :2])
    return np.column_stack((positions, wrap_rads(poses[:, 2] + start.heading_rad)))


def rigid_fit(points_m: FloatArray, onto_m: FloatArray, weights: FloatArray | None = None) -> Pose2:
    """The motion that brings points (n, 2) onto others with the least sum of squares (Arun et al. 1987, no scale).

    weights (n,): of the squares; all the same without.
    """
    centre, target = (np.average(rows, axis=0, weights=weights) for rows in (points_m, onto_m))
    a, b = points_m - centre, onto_m - target
    a_weighted = a if weights is None else a * weights[:, None]
    crossed = a_weighted[:, 0] * b[:, 1] - a_weighted[:, 1] * b[:, 0]
    heading = float(np.arctan2(crossed.sum(), (a_weighted * b).sum()))
    turned = Pose2(0.0, 0.0, heading).transform(centre)
    return Pose2(float(target[0] - turned[0]), float(target[1] - turned[1]), heading)


def position_error(estimated_m: FloatArray, true_m: FloatArray) -> PositionError:
    """Of positions (n, 2), as they stand."""
    with np.errstate(over="ignore"):  # a record may hold a pose of 1e200 m: it is infinitely far off
        squares = np.sort(((estimated_m - true_m) ** 2).sum(axis=1))
    kept = squares[: max(1, int(np.ceil(0.95 * len(squares))))]
    return PositionError(float(np.sqrt(squares[-1])), float(np.sqrt(squares.mean())), float(np.sqrt(kept.mean())))


def trajectory_error(map_from_body: FloatArray, world_from_body: FloatArray) -> TrajectoryError:
    """Of poses (n, 3); row 0 of both is where the drive starts, map frame and world frame may differ."""
    if map_from_body.shape != world_from_body.shape or len(map_from_body) == 0:
        raise ValueError(f"{map_from_body.shape=} but {world_from_body.shape=}")
    estimated, true = in_start_frame(map_from_body), in_start_frame(world_from_body)
    fitted = rigid_fit(estimated[:, :2], true[:, :2]).transform(estimated[:, :2])
    return TrajectoryError(
        position_error(estimated[:, :2], true[:, :2]),
        position_error(fitted, true[:, :2]),
    )


def squared_pose_errors(map_from_body: FloatArray, covariances: FloatArray, true_poses: FloatArray) -> FloatArray:
    """NEES (n,) of poses (n, 3) with covariances (n, 3, 3), both in the same frame as the true poses (n, 3).

    Normalised estimation error squared: 3 on average when the covariance is right. Rows without uncertainty, as at the
    start where the map frame is defined, are NaN.
    """
    errors = map_from_body - true_poses
    errors[:, 2] = wrap_rads(errors[:, 2])
    values = np.full(len(errors), np.nan)
    for row, covariance in enumerate(covariances):
        if np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 1e-14:
            values[row] = float(errors[row] @ np.linalg.solve(covariance, errors[row]))
    return values
