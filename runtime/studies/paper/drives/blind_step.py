"""One strongly nonlinear step: metres of dead reckoning with a heading that nobody knows, then landmarks again.

Here the unscented proposal has what it claims to be good for: the way from pose to sighting is far from linear.
"""

import math

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.arms import arm_settings, merged
from slam.observations import FeatureRows, Features, usable_rows
from slam.odometry.odometry import Increment
from slam.particles.fastslam import FastSlam
from slam.pose import wrap_rads
from slam.settings.slam import SlamSettings

TRIALS = 60
AHEAD_M = 5.0
LANDMARKS_M = np.array(((9.0, 2.0), (6.0, -5.0), (12.0, -1.0)))
RANGE_NOISE_M, BEARING_NOISE_RAD = 0.05, math.radians(0.5)
SPREADS_DEG = (5, 15, 30)
ALONG_M, ACROSS_M = 0.2, 0.05


def blind_step(
    seed: int,
    arm: str,
    particles: int,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """Mean position error m of the particles after the step, over 60 trials for each spread of the heading.

    Identities are known, so that nothing but the proposal differs. `code` as in feature_drive.
    """
    changes = {
        "particles": particles,
        "association": {"strategy": "known"},
        "gates": {"match_known": 2000.0},
        "techniques": {"existence": False},
    }
    settings = SlamSettings.model_validate(merged(arm_settings(arm), changes))
    result: Result = {}
    for spread_deg in SPREADS_DEG:
        generator = np.random.default_rng([seed, spread_deg])
        errors = [_trial(settings, math.radians(spread_deg), generator) for _ in range(TRIALS)]
        result[f"particles_error_{spread_deg}deg_m"] = float(np.mean(errors))
    return result


def _trial(settings: SlamSettings, spread_rad: float, generator: np.random.Generator) -> float:
    """The landmarks from rest, an arc into the blind, the landmarks again."""
    world = np.random.default_rng(int(generator.integers(1 << 32)))
    filter_ = FastSlam(settings, np.random.default_rng(int(generator.integers(1 << 32))))
    turn = spread_rad * float(world.standard_normal())
    ahead = AHEAD_M + ALONG_M * float(world.standard_normal())
    across = ACROSS_M * float(world.standard_normal())
    half = 0.5 * turn  # turned on the way: the chord of an arc
    true = np.array((ahead * math.cos(half) - across * math.sin(half), ahead * math.sin(half) + across, turn))
    filter_.step(_increment(np.zeros(3), np.zeros((3, 3)), at_rest=True), _seen(0, np.zeros(3), world))
    covariance = _arc_covariance(spread_rad)
    filter_.step(_increment(np.array((AHEAD_M, 0.0, 0.0)), covariance, at_rest=False), _seen(1, true, world))
    mean, _ = filter_.mean()
    return math.hypot(mean.x_m - true[0], mean.y_m - true[1])


def _arc_covariance(spread_rad: float) -> FloatArray:
    """First order: half the turn bends the chord to the side."""
    covariance = np.diag((ALONG_M**2, ACROSS_M**2, spread_rad**2))
    side = 0.5 * AHEAD_M * spread_rad**2
    covariance[1, 1] += (0.5 * AHEAD_M * spread_rad) ** 2
    covariance[1, 2] = covariance[2, 1] = side
    return covariance


def _increment(mean: FloatArray, covariance: FloatArray, *, at_rest: bool) -> Increment:
    return Increment(mean, covariance, at_rest, True, AHEAD_M, 0.0, 0.0, 0.0, AHEAD_M)


def _seen(scan: int, pose: FloatArray, generator: np.random.Generator) -> FeatureRows:
    offsets = LANDMARKS_M - pose[:2]
    noise = generator.standard_normal((len(offsets), 2))
    ranges = np.hypot(*offsets.T) + RANGE_NOISE_M * noise[:, 0]
    bearings = wrap_rads(np.arctan2(offsets[:, 1], offsets[:, 0]) - pose[2] + BEARING_NOISE_RAD * noise[:, 1])
    count = len(offsets)
    covariances = np.tile(np.diag((RANGE_NOISE_M**2, BEARING_NOISE_RAD**2)), (count, 1, 1))
    identities = np.arange(count)
    may_create = np.ones(count, dtype=np.bool_)
    features = Features(scan, ranges, bearings, covariances, may_create, identities, identities)
    return usable_rows(features, math.inf, 0.0)
