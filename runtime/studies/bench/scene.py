"""A field of point landmarks that the filter already knows, and scans of some of them, for measuring the step."""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.joint.gaussian import JointGaussian
from slam.observations import FeatureRows, Features, usable_rows
from slam.odometry.odometry import Increment
from slam.particles.fastslam import FastSlam
from slam.pose import Pose2, wrap_rads
from slam.settings.slam import SlamSettings
from slam.visibility import SightLine, field_of_view

DENSITY_PER_M2 = 0.02  # 42 landmarks in 270 deg to 30 m: enough for 30 observations
THICKET_PER_M2 = 0.47  # 1000 landmarks in that view
VIEW_M, VIEW_RAD = 30.0, math.radians(135.0)
TILE_M = 30.0  # the survey stops this often: every landmark is in view of some stop
STEP_M, TURN_RAD = 0.05, 0.005  # 0.5 m/s and a circle of 10 m, ten scans a second
SIGMA_M, SIGMA_RAD = 0.05, 0.005
SEED = 1
SURVEY_M = 0.75 * TILE_M  # the corners of a tile are 0.71 away
STANDING = 3  # scans at a stop: four looks confirm a landmark
BLIND = SightLine(-math.pi, math.pi / 180.0, VIEW_M, np.full(361, 0.1))  # sees past nothing: nothing is missed
SIGHT = field_of_view(VIEW_M - 5.0, VIEW_RAD - math.radians(5.0))


class Scene:
    """N landmarks on a jittered grid, a filter with a finished map of them, and its drive in a small circle."""

    def __init__(
        self, particles: int, landmarks: int, observations: int, density_per_m2: float = DENSITY_PER_M2
    ) -> None:
        self._rng = np.random.default_rng(SEED)
        self._observations = observations
        side = math.ceil(math.sqrt(landmarks))
        pitch_m = 1.0 / math.sqrt(density_per_m2)
        grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)[:landmarks]
        jitter = self._rng.uniform(-0.25, 0.25, grid.shape)
        self.landmarks_m: FloatArray = (grid - 0.5 * side + jitter) * pitch_m
        settings = SlamSettings(particles=particles)
        self.particles = FastSlam(settings, np.random.default_rng(SEED))
        self.joint = JointGaussian(settings.joint, Pose2(), settings.tuning())
        self._pose = Pose2()
        self._scan = 0
        self._survey(0.5 * side * pitch_m)

    def next_scan(self) -> tuple[Increment, FeatureRows]:
        """Drive one step of the circle and look at the nearest landmarks in view."""
        moved = np.array((STEP_M, 0.0, TURN_RAD))
        self._pose = self._pose @ Pose2(*moved)
        covariance = np.diag((0.004**2, 0.001**2, 0.002**2))
        increment = Increment(moved, covariance, False, True, 0.1, 0.5, 0.0, 0.05, 0.1)
        return increment, self._look(self._observations, VIEW_RAD, VIEW_M)

    def step(self, increment: Increment, features: FeatureRows, sight: SightLine = SIGHT) -> None:
        """Particles and joint Gaussian, as the estimator calls them."""
        outcome = self.particles.step(increment, features, sight)
        self.joint.step(increment.mean, increment.covariance, features, outcome.matches, sight)

    def _survey(self, half_side_m: float) -> None:
        """Make the map through the same door: go to every tile without noise, stand, and look all around."""
        everything = len(self.landmarks_m)
        for place in survey_stops(half_side_m):
            moved = (self._pose.inverse() @ place).as_array()
            self._pose = place
            arriving = Increment(moved, np.eye(3) * 1e-12, False, True, 0.1, 0.0, 0.0, 0.0, 0.1)
            self.step(arriving, self._look(everything, math.pi, SURVEY_M), BLIND)
            standing = Increment(np.zeros(3), np.zeros((3, 3)), True, True, 0.1, 0.0, 0.0, 0.0, 0.0)
            for _ in range(STANDING):
                self.step(standing, self._look(everything, math.pi, SURVEY_M), BLIND)
            before = math.inf
            while self.joint.landmarks_in_state < before:  # what is far away leaves the joint state, some in each scan
                before = self.joint.landmarks_in_state
                self.step(standing, self._look(0, math.pi, SURVEY_M), BLIND)

    def _look(self, most: int, view_rad: float, view_m: float) -> FeatureRows:
        """The nearest `most` landmarks within view_m and view_rad to either side, with noise."""
        offsets = self._pose.inverse().transform(self.landmarks_m)
        ranges, bearings = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
        seen = np.flatnonzero((ranges < view_m) & (np.abs(bearings) < view_rad) & (ranges > 0.5))
        seen = seen[np.argsort(ranges[seen])][:most]
        count = seen.size
        self._scan += 1
        features = Features(
            self._scan * 100_000_000,
            ranges[seen] + SIGMA_M * self._rng.standard_normal(count),
            wrap_rads(bearings[seen] + SIGMA_RAD * self._rng.standard_normal(count)),
            np.tile(np.diag((SIGMA_M**2, SIGMA_RAD**2)), (count, 1, 1)),
            np.ones(count, dtype=np.bool_),
            np.full(count, -1, dtype=np.int64),
            np.full(count, -1, dtype=np.int64),
        )
        return usable_rows(features, VIEW_M, 0.0)


def survey_stops(half_side_m: float) -> list[Pose2]:
    """A way over a square that a rover could drive: row after row to and fro, then straight to the middle."""
    stops = np.arange(-half_side_m, half_side_m + TILE_M, TILE_M)
    rows = [(x, y) for row, y in enumerate(stops) for x in (stops if row % 2 == 0 else stops[::-1])]
    last = np.array(rows[-1])
    hops = math.ceil(float(np.hypot(*last)) / TILE_M)
    home = [tuple(last * (1.0 - hop / hops)) for hop in range(1, hops + 1)]
    return [Pose2(float(x), float(y), 0.0) for x, y in (*rows, *home)]
