"""The particles: each a pose and its own map of landmarks."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.functions import normals
from slam.arithmetic.small_matrices import applied, product
from slam.observations import IDENTITIES_PER_SCAN, FeatureRows
from slam.odometry.odometry import Increment
from slam.particles.redraw import redrawn
from slam.particles.resampling import adopt_maps, effective_particles, normalised, parents_in_place, systematic_copies
from slam.particles.step import (
    CREATED,
    LIKELIHOODS,
    REMOVED,
    SHARED_NEEDED,
    TALLIES,
    ScanInput,
    StepResult,
    landmarks_near,
    step_particles,
)
from slam.particles.store import LandmarkStore
from slam.pose import Pose2, wrap_rad, wrap_rads
from slam.settings.slam import SlamSettings
from slam.settings.tuning import Strategy
from slam.visibility import NO_SIGHT, SightLine


@dataclass(frozen=True, slots=True, eq=False)
class ScanOutcome:
    """What one scan did.

    matches (K,): identity or MatchVerdict of each feature in the best particle. effective: particles before resampling.
    """

    matches: IntArray
    effective: float
    resampled: bool
    likelihoods: int
    created: float
    removed: float

    @property
    def figures(self) -> dict[str, float]:
        """For the record."""
        return {
            "created": self.created,
            "removed": self.removed,
            "likelihoods": float(self.likelihoods),
            "effective_particles": self.effective,
            "resampled": float(self.resampled),
        }


class FastSlam:
    """Unscented FastSLAM with unknown association. poses (M, 3), log_weights (M,), weights (M,) of the last scan."""

    def __init__(self, settings: SlamSettings, generator: np.random.Generator) -> None:
        self._settings = settings
        self._generator = generator
        self._tuning = settings.tuning()
        self._mount = settings.mount.as_pose().as_array()
        self.store = LandmarkStore(settings.particles, self._tuning.cell_m)
        self.poses = np.zeros((settings.particles, 3))
        self.log_weights = np.zeros(settings.particles)
        self.weights = normalised(self.log_weights)
        self.weighted_poses = self.poses
        self.best = 0
        self.scans = 0

    def step(self, increment: Increment, features: FeatureRows, sight: SightLine = NO_SIGHT) -> ScanOutcome:
        """One scan: predict, associate, sample, weight, update and existence in every particle, then resample."""
        drawn = normals(self._generator, len(self.poses))
        names = self._names(features)
        matches, tallies = self._step_all(
            ScanInput(increment.mean, increment.covariance, drawn, self._mount, features, names, sight)
        )
        self.weights = normalised(self.log_weights)
        self.best = int(np.argmax(self.weights))
        effective = effective_particles(self.weights)
        resampled = effective < self._settings.resample_share * len(self.poses)
        if resampled:
            self._resample()
        else:
            self.log_weights = self.log_weights - self.log_weights[self.best]
        self.scans += 1
        share = 1.0 / len(self.poses)
        return ScanOutcome(
            matches[self.best].copy(),
            effective,
            resampled,
            int(tallies[LIKELIHOODS]),
            float(tallies[CREATED]) * share,
            float(tallies[REMOVED]) * share,
        )

    def redraw(self, mean: FloatArray, covariance: FloatArray, identities: IntArray, log_odds: FloatArray) -> None:
        """Begin anew from a Gaussian over the pose and landmarks (L,): mean (3 + 2 L,) and its covariance."""
        drawn = normals(self._generator, len(self.poses))
        self.poses, self.store = redrawn(
            mean, covariance, identities, log_odds, drawn, self._tuning.cell_m, self._settings.view.range_max_m
        )
        self.log_weights = np.zeros(len(self.poses))
        self.weights = normalised(self.log_weights)
        self.weighted_poses, self.best = self.poses, 0

    def mean(self) -> tuple[Pose2, FloatArray]:
        """Weighted mean and covariance (3, 3) of the last scan, before resampling."""
        return weighted_mean(self.weighted_poses, self.weights)

    def map_in_view(self) -> tuple[FloatArray, IntArray]:
        """Numbers (C, 6) and identities (C,) of the best particle's landmarks around it, in the order of storage."""
        x, y = self.poses[self.best, :2]
        view = self._settings.view
        return landmarks_near(self.store.pages, self.best, self.store.cell_m, x, y, view.range_max_m)

    def _names(self, features: FeatureRows) -> IntArray:
        """(K,) identities of the landmarks that the features may create."""
        known = self._tuning.strategy == Strategy.KNOWN
        return features.identities if known else self.scans * IDENTITIES_PER_SCAN + features.numbers

    def _step_all(self, scan: ScanInput) -> tuple[IntArray, IntArray]:
        """Run the compiled step over all particles, enlarging the store where it asks for it; matches and tallies."""
        count = scan.features.ranges_m.size
        matches = np.empty((len(self.poses), count), dtype=np.int64)
        result = StepResult(self.log_weights, matches, np.zeros(TALLIES, dtype=np.int64))
        self.store.cover(self.poses, self._settings.view.range_max_m + float(np.abs(scan.increment[:2]).sum()))
        self.poses = self.poses.copy()  # the estimate of the scan before still shows the old ones
        done = 0
        while done < len(self.poses):
            done = step_particles(self.store.pages, self.poses, done, scan, self._tuning, result)
            if done < len(self.poses):
                self.store.grow(count, int(result.tallies[SHARED_NEEDED]))
        self.weighted_poses = self.poses
        return matches, result.tallies

    def _resample(self) -> None:
        """Systematic: survivors stay in their place, the others take over a survivor's pose and map."""
        copies = systematic_copies(self.weights, float(self._generator.random()))
        parents = parents_in_place(copies)
        adopt_maps(self.store.pages, parents)
        self.poses = self.poses[parents]
        self.log_weights = np.zeros(len(self.poses))


def weighted_mean(poses: FloatArray, weights: FloatArray) -> tuple[Pose2, FloatArray]:
    """Mean pose and covariance (3, 3) of weighted poses (M, 3); headings are averaged about the heaviest one."""
    reference = float(poses[int(np.argmax(weights)), 2])
    deviations = poses.copy()
    deviations[:, 2] = wrap_rads(poses[:, 2] - reference)
    mean = applied(deviations.T, weights)
    centred = deviations - mean
    return Pose2(float(mean[0]), float(mean[1]), wrap_rad(reference + float(mean[2]))), product(
        weights * centred.T, centred
    )
