"""How far a path is from what a recording knows of the truth, at every time of the truth: arrays in, figures out.

Paths are rows (n, 4) of t s, x m, y m, heading rad of the body, in the time of the truth and any frame.
"""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.evaluate.errors import LEAST_FIT_POINTS, PositionError, position_error, rigid_fit
from runtime.evaluate.rows import poses_at, relative_poses
from runtime.evaluate.truth import NO_OFFSET, DataSetTruth, Mount
from slam.pose import composed, wrap_rads


@dataclass(frozen=True, slots=True)
class RelationError:
    """Mean and standard deviation of (true relation)^-1 (estimated relation) (Kuemmerle et al. 2009)."""

    translation_m: float
    translation_std_m: float
    rotation_deg: float
    rotation_std_deg: float


@dataclass(frozen=True, slots=True)
class PathError:
    """Error of one path; None where the truth is silent. `used` counts the parts of the truth that the path reaches.

    position: after the best rigid fit of all places used; None below three of them.
    """

    position: PositionError | None = None
    positions_used: int = 0
    positions_known: int = 0
    relation: RelationError | None = None
    relations_used: int = 0
    relations_known: int = 0


@dataclass(frozen=True, slots=True)
class TruthComparison:
    """The published path and odometry alone against one truth."""

    published: PathError
    odometry: PathError

    @property
    def over_odometry(self) -> float | None:
        """Published error over that of odometry, of verified relations where there are any, else of positions.

        None without truth.
        """
        for published_m, odometry_m in (
            (_translation(self.published), _translation(self.odometry)),
            (_rms(self.published), _rms(self.odometry)),
        ):
            if published_m is not None and odometry_m is not None:
                return published_m / odometry_m if odometry_m > 0.0 else np.inf
        return None


def compare_with_truth(
    published: FloatArray, odometry: FloatArray, truth: DataSetTruth, body_from_laser: Mount = NO_OFFSET
) -> TruthComparison:
    """Errors of the published pose and of odometry against whatever the truth has."""
    return TruthComparison(*(path_error(path, truth, body_from_laser) for path in (published, odometry)))


def path_error(path: FloatArray, truth: DataSetTruth, body_from_laser: Mount = NO_OFFSET) -> PathError:
    """Fixes or poses give the error of the position, relations that of the shape."""
    places = truth.fixes if truth.fixes is not None else truth.poses
    position, used = None, 0
    if places is not None:
        position, used = fitted_error(path, places, truth.point(body_from_laser))
    relation, related = None, 0
    if truth.relations is not None:
        relation, related = relation_error(at_laser(path, body_from_laser), truth.relations)
    return PathError(
        position,
        used,
        0 if places is None else len(places),
        relation,
        related,
        0 if truth.relations is None else len(truth.relations),
    )


def fitted_error(path: FloatArray, places: FloatArray, offset: Mount = NO_OFFSET) -> tuple[PositionError | None, int]:
    """Error of a point of the body at `offset` after the best rigid fit onto places (k, >= 3) of t s, x m, y m.

    Also how many places the path reaches; no error below three.
    """
    points_m = composed(poses_at(path, places[:, 0]), np.array(offset))[:, :2]
    known = np.isfinite(points_m[:, 0]) & np.isfinite(places[:, :3]).all(axis=1)
    used = int(known.sum())
    if used < LEAST_FIT_POINTS:
        return None, used
    points_m, places_m = points_m[known], places[known, 1:3]
    return position_error(rigid_fit(points_m, places_m).transform(points_m), places_m), used


def relation_error(path: FloatArray, relations: FloatArray) -> tuple[RelationError | None, int]:
    """Error of relations (k, 5) of t1 s, t2 s, dx m, dy m, turn rad, and how many of them the path reaches."""
    first, second = poses_at(path, relations[:, 0]), poses_at(path, relations[:, 1])
    known = np.isfinite(first[:, 0]) & np.isfinite(second[:, 0])
    if not known.any():
        return None, 0
    error = relative_poses(relations[known, 2:5], relative_poses(first[known], second[known]))
    metres, degrees = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
    mean = RelationError(float(metres.mean()), float(metres.std()), float(degrees.mean()), float(degrees.std()))
    return mean, int(known.sum())


def at_laser(path: FloatArray, body_from_laser: Mount) -> FloatArray:
    """The path of the laser instead of the body."""
    laser = composed(path[:, 1:], np.array(body_from_laser))
    return np.column_stack((path[:, 0], laser[:, :2], wrap_rads(laser[:, 2])))


def _translation(error: PathError) -> float | None:
    return None if error.relation is None else error.relation.translation_m


def _rms(error: PathError) -> float | None:
    return None if error.position is None else error.position.rms_m
