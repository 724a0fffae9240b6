"""The factor graph of a drive: poses of the laser and landmarks, tied by motions, sightings and scans laid onto others.

gtsam solves it (Levenberg-Marquardt, Dellaert and Kaess 2017). Every factor has a Cauchy kernel, so that a wrong match
or a slip of the wheels does not bend the rest.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.measurements import FloatArray, IntArray
from runtime.optional_packages import needs
from runtime.smooth.sightings import DriveTold, Sightings
from slam.pose import composed, inverted, rotated, wrap_rads

CAUCHY = 2.385  # in standard deviations: 95 % efficient where errors are Gaussian (Zhang 1997)
FLOORS = np.array((1e-4, 1e-4, 1e-5)) ** 2  # m^2, m^2, rad^2 of a motion: at rest it is known exactly
ANCHOR = np.array((1e-3, 1e-3, 1e-4))  # m, m, rad: the map's frame is given by one pose
MOST_ITERATIONS = 30
RELATIVE_TOLERANCE = 1e-5
UNKNOWN = 1e-6  # information in a direction in which a scan can slide along what it is laid onto


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Factors on standard deviations: of ranges, of bearings, of motions; and what the odometry is off by always:
    distances are longer by the first, turns by the second (shares), and every metre turns by the third (rad/m) more.
    """

    ranges: float = 1.0
    bearings: float = 1.0
    motions: float = 1.0
    constants: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """poses (n, 3) of the body, landmarks (l, 2) of `identities` (l,). gaps (m, 2): of sightings from what the solution
    says, range m and bearing rad. values, graph: as gtsam has them.
    """

    poses: FloatArray
    identities: IntArray
    landmarks: FloatArray
    gaps: FloatArray
    values: Any
    graph: Any

    def covariances(self) -> "Covariances":
        """Of all of it."""
        with needs("gtsam", "infant smooth"):
            import gtsam
        return Covariances(gtsam.Marginals(self.graph, self.values))


class Covariances:
    """Of poses and landmarks of a solution; each is computed when it is asked for, in some milliseconds."""

    def __init__(self, marginals: Any) -> None:
        self._marginals = marginals

    def pose(self, scan: int, pose: FloatArray, body_from_laser: FloatArray) -> FloatArray:
        """(3, 3) of the body's x, y, heading in the map at one scan, where the pose (3,) is."""
        local = np.asarray(self._marginals.marginalCovariance(_pose_key(scan)))
        turn = np.eye(3)
        turn[:2, :2] = rotated(np.eye(2), float(body_from_laser[2])).T
        turn[:2, 2] = body_from_laser[1], -body_from_laser[0]
        upright = np.eye(3)
        upright[:2, :2] = rotated(np.eye(2), float(pose[2])).T
        by = upright @ turn
        return np.asarray(by @ local @ by.T)

    def landmark(self, number: int) -> FloatArray:
        """(2, 2) of one landmark."""
        return np.asarray(self._marginals.marginalCovariance(_landmark_key(number)))

    def between(self, first: int, second: int) -> FloatArray:
        """(2, 2) of the way from one landmark to another."""
        keys = [_landmark_key(first), _landmark_key(second)]
        joint = self._marginals.jointMarginalCovariance(keys)
        a, b = keys
        cross = joint.at(a, b)
        return np.asarray(joint.at(a, a) + joint.at(b, b) - cross - cross.T)


def corrected(motions: FloatArray, constants: tuple[float, float, float]) -> FloatArray:
    """Motions (n, 3) without what the odometry is off by always, as slam.joint.kernels.predict corrects them."""
    stretch, turn, sway = constants
    more = turn * motions[:, 2] + sway * np.hypot(motions[:, 0], motions[:, 1])
    moved = (1.0 + stretch) * rotated(motions[:, :2], 0.5 * more)
    return np.column_stack((moved, motions[:, 2] + more))


def solve(told: DriveTold, sightings: Sightings, noise: Noise, start: FloatArray, anchor: int) -> Solution:
    """The path (n, 3) and landmarks that explain all of it best, from a path to start with. Raises UsageError."""
    with needs("gtsam", "infant smooth"):
        import gtsam
    mount = told.body_from_laser
    lasers = composed(start, mount)
    identities, index = np.unique(sightings.identities, return_inverse=True)
    points = _first_places(lasers, sightings, index, len(identities))
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for number, pose in enumerate(lasers.tolist()):
        values.insert(_pose_key(number), gtsam.Pose2(*pose))
    for number, point in enumerate(points):
        values.insert(_landmark_key(number), point)
    place = gtsam.Pose2(*lasers[anchor].tolist())
    graph.add(gtsam.PriorFactorPose2(_pose_key(anchor), place, gtsam.noiseModel.Diagonal.Sigmas(ANCHOR)))
    _tie_poses(gtsam, graph, told, noise)
    _tie_landmarks(gtsam, graph, sightings, index, noise)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(MOST_ITERATIONS)
    parameters.setRelativeErrorTol(RELATIVE_TOLERANCE)
    parameters.setOrderingType("COLAMD")
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    lasers = np.array([_array(values.atPose2(_pose_key(number))) for number in range(len(lasers))]).reshape(-1, 3)
    points = np.array([values.atPoint2(_landmark_key(number)) for number in range(len(identities))]).reshape(-1, 2)
    poses = composed(lasers, inverted(mount))
    poses[:, 2] = wrap_rads(poses[:, 2])
    return Solution(poses, identities, points, gaps_of(lasers, points, sightings, index), values, graph)


def gaps_of(lasers: FloatArray, points: FloatArray, sightings: Sightings, index: IntArray) -> FloatArray:
    """(m, 2) range m and bearing rad that were seen less those that poses and points give."""
    off = points[index] - lasers[sightings.scans, :2]
    bearings = np.arctan2(off[:, 1], off[:, 0]) - lasers[sightings.scans, 2]
    return np.column_stack(
        (sightings.ranges_m - np.hypot(off[:, 0], off[:, 1]), wrap_rads(sightings.bearings_rad - bearings))
    )


def laser_motions(motions: FloatArray, covariances: FloatArray, mount: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Motions (n, 3) of the body as those of the laser, and their covariances, from the axes of before to of after."""
    moved = composed(composed(inverted(mount), motions), mount)
    arm = np.eye(3)
    arm[:2, :2] = rotated(np.eye(2), -float(mount[2])).T
    arm[:2, 2] = arm[:2, :2] @ np.array((-mount[1], mount[0]))
    turns = np.zeros((len(motions), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(motions[:, 2])
    turns[:, 0, 1], turns[:, 1, 0] = np.sin(motions[:, 2]), -np.sin(motions[:, 2])
    turns[:, 2, 2] = 1.0
    by = arm @ turns
    spread = by @ covariances @ by.transpose(0, 2, 1)
    return moved, 0.5 * (spread + spread.transpose(0, 2, 1)) + np.diag(FLOORS)


def _tie_poses(gtsam: Any, graph: Any, told: DriveTold, noise: Noise) -> None:
    """By motions and by scans laid onto earlier ones."""
    mount = told.body_from_laser
    motions, covariances = laser_motions(corrected(told.motions, noise.constants), told.motion_covariances, mount)
    for number in range(1, len(motions)):
        keys = (_pose_key(number - 1), _pose_key(number))
        model = _robust(gtsam, covariances[number] * noise.motions**2)
        graph.add(gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*motions[number].tolist()), model))
    fits = told.fits
    spreads: FloatArray = np.asarray(np.linalg.inv(fits.informations + UNKNOWN * np.eye(3)), dtype=np.float64)
    motions, covariances = laser_motions(fits.motions, spreads, mount)
    for earlier, later, motion, covariance in zip(
        fits.earlier.tolist(), fits.later.tolist(), motions.tolist(), covariances, strict=True
    ):
        keys = (_pose_key(earlier), _pose_key(later))
        graph.add(gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*motion), _robust(gtsam, covariance)))


def _tie_landmarks(gtsam: Any, graph: Any, sightings: Sightings, index: IntArray, noise: Noise) -> None:
    """By sightings of landmarks number index (m,)."""
    scale = np.outer((noise.bearings, noise.ranges), (noise.bearings, noise.ranges))
    spreads = np.array(((sightings.bb, sightings.rb), (sightings.rb, sightings.rr))).transpose(2, 0, 1) * scale
    columns = (sightings.scans.tolist(), index.tolist(), sightings.bearings_rad.tolist(), sightings.ranges_m.tolist())
    for scan, landmark, bearing, metres, spread in zip(*columns, spreads, strict=True):
        keys = (_pose_key(scan), _landmark_key(landmark))
        graph.add(gtsam.BearingRangeFactor2D(*keys, gtsam.Rot2(bearing), metres, _robust(gtsam, spread)))


def _robust(gtsam: Any, covariance: FloatArray) -> Any:
    models = gtsam.noiseModel
    return models.Robust.Create(models.mEstimator.Cauchy.Create(CAUCHY), models.Gaussian.Covariance(covariance))


def _first_places(lasers: FloatArray, sightings: Sightings, index: IntArray, count: int) -> FloatArray:
    """(l, 2) where the median of its sightings puts every landmark."""
    heading = lasers[sightings.scans, 2] + sightings.bearings_rad
    seen = lasers[sightings.scans, :2] + sightings.ranges_m[:, None] * np.column_stack(
        (np.cos(heading), np.sin(heading))
    )
    order = np.argsort(index, kind="stable")
    groups = np.split(seen[order], np.cumsum(np.bincount(index, minlength=count))[:-1])
    return np.array([np.median(group, axis=0) for group in groups]).reshape(-1, 2)


def _pose_key(number: int) -> int:
    return 2 * number


def _landmark_key(number: int) -> int:
    return 2 * number + 1


def _array(pose: Any) -> FloatArray:
    return np.array((pose.x(), pose.y(), pose.theta()))
