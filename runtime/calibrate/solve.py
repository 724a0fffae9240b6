"""Maximum likelihood of the parameters, given what wheels and laser say of the same steps.

Residual of a step: motion of the laser that the wheels and the parameters predict, minus the one that matching found. Its
covariance is that of the match times a factor, plus slip of each wheel and sideways drift in proportion to the metres
driven; factor, slip and drift are estimated together with the rest (variance components), so nothing has to be known
beforehand. Steps that fit with no slip of this size are left out.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from runtime.calibrate.laser_motion import LaserMotion
from runtime.calibrate.track import chord, composed, inverted, seen_by_laser
from runtime.calibrate.wheel_model import WheelModel

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
ResidualsAt = Callable[[FloatArray], FloatArray]

LATENCY_BOUND_S = 0.5  # beyond it is no latency but a fault of the clocks
GATE = 21.1  # chi-squared, 3 degrees of freedom: one good step in ten thousand is left out
ROUNDS, DESCENTS = 8, 8
ROBUST = 2.5
LATENCY_STEP_S = 0.1
NOISE_START = (0.01, 0.005, 1.0)  # slip and drift m per sqrt(m), factor on the matching deviation
NOISE_BOUNDS = ((1e-5, 0.5), (1e-5, 0.5), (0.3, 20.0))
CLUSTERS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """parameters (p,) and covariance (p, p); noise (3,): slip, drift, factor, and covariance of their logarithms (3, 3).

    steps: those used; outliers: those left out; residual_scale: root mean square of whitened residuals, near 1.
    """

    parameters: FloatArray
    covariance: FloatArray
    noise: FloatArray
    noise_log_covariance: FloatArray
    steps: int
    outliers: int
    residual_scale: float


@dataclass(frozen=True, slots=True, eq=False)
class _Components:
    """Covariance of each step = slip^2 * slip_part + drift^2 * drift_part + factor^2 * match_part + fixed_part, (n, 3, 3) each."""

    slip: FloatArray
    drift: FloatArray
    match: FloatArray
    fixed: FloatArray

    def total(self, noise: FloatArray) -> FloatArray:
        """(n, 3, 3)."""
        total: FloatArray = noise[0] ** 2 * self.slip + noise[1] ** 2 * self.drift + noise[2] ** 2 * self.match + self.fixed
        return total


def predicted(motion: LaserMotion, model: WheelModel, parameters: FloatArray) -> FloatArray:
    """Motion (n, 3) of the laser in every step as the wheels tell it."""
    return seen_by_laser(_body_steps(motion, model, parameters), parameters[-4:-1])


def solve(motions: Sequence[LaserMotion], model: WheelModel) -> Solution:
    """Alternate between parameters, noise and outliers until the same steps stay in use."""
    parameters, noise = model.start.copy(), np.array(NOISE_START)
    observed = np.concatenate([motion.means for motion in motions])
    kept = np.ones(len(observed), dtype=np.bool_)

    def residuals_at(values: FloatArray) -> FloatArray:
        difference = np.concatenate([predicted(motion, model, values) for motion in motions]) - observed
        difference[:, 2] = np.mod(difference[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        return difference

    for turn in range(ROUNDS):
        components = _components(motions, model, parameters)
        whitening = _whitening(components.total(noise))
        parameters = _fit(residuals_at, whitening, kept, model, parameters, robust=turn < 2)
        residuals = residuals_at(parameters)
        components = _components(motions, model, parameters)
        noise = _noise(residuals[kept], _part(components, kept), noise)
        distances = _squared(residuals, components.total(noise))
        still = distances < GATE
        if turn >= 2 and np.array_equal(still, kept):
            break
        kept = still
    whitening = _whitening(components.total(noise))
    covariance = _covariance(residuals_at, whitening, kept, model, parameters)
    part = _part(components, kept)
    return Solution(
        parameters,
        covariance,
        noise,
        _noise_log_covariance(residuals[kept], part, noise),
        int(kept.sum()),
        int((~kept).sum()),
        math.sqrt(float(np.mean(distances[kept])) / 3.0) if kept.any() else math.nan,
    )


def _body_steps(motion: LaserMotion, model: WheelModel, parameters: FloatArray) -> FloatArray:
    wheels = model.track(motion.series, parameters)
    poses = wheels.at(motion.times_s.ravel() - parameters[-1]).reshape(-1, 2, 3)
    return composed(inverted(poses[:, 0]), poses[:, 1])


def _components(motions: Sequence[LaserMotion], model: WheelModel, parameters: FloatArray) -> _Components:
    arms = model.noise_arms(parameters)
    slips, drifts, fixed = [], [], []
    for motion in motions:
        steps = _body_steps(motion, model, parameters)
        times = motion.times_s.ravel() - parameters[-1]
        weights = np.diff(model.noise_weights(motion.series, parameters, times).reshape(-1, 2, 2), axis=1)[:, 0]
        by_motion = _twist_jacobian(steps, parameters[-4:-1])  # laser motion by distance, sideways, heading
        by_error = by_motion[:, :, (0, 2)] @ arms.T  # laser motion by the two errors
        slips.append(np.einsum("nie,ne,nje->nij", by_error, weights, by_error))
        fixed.append(model.quantisation_m2(parameters) * by_error @ by_error.transpose(0, 2, 1))
        across = by_motion[:, :, 1]
        rolled = weights.mean(axis=1)
        drifts.append(rolled[:, None, None] * across[:, :, None] * across[:, None, :])
        # slip that happens along the way, not in its middle, also carries sideways
        heading = np.einsum("e,ne,e->n", arms[:, 1], weights, arms[:, 1])
        spread = heading * (steps[:, 0] ** 2 + steps[:, 1] ** 2) / 12.0
        slips[-1] += spread[:, None, None] * across[:, :, None] * across[:, None, :]
    covariances = np.concatenate([motion.covariances for motion in motions])
    return _Components(np.concatenate(slips), np.concatenate(drifts), covariances, np.concatenate(fixed))


def _twist_jacobian(steps: FloatArray, mount: FloatArray) -> FloatArray:
    """(n, 3, 3): columns are what a metre more ahead, a metre sideways and a radian more do to the laser's motion."""
    turn = steps[:, 2]
    half = 0.5 * turn
    ahead, left = chord(np.ones_like(turn), turn)
    columns = np.zeros((len(steps), 3, 3))
    columns[:, 0, 0], columns[:, 1, 0] = ahead, left
    columns[:, 0, 1], columns[:, 1, 1] = -np.sin(half), np.cos(half)
    arm_x = np.cos(turn) * mount[0] - np.sin(turn) * mount[1]
    arm_y = np.sin(turn) * mount[0] + np.cos(turn) * mount[1]
    # a heading error in the middle of the way turns its second half
    columns[:, 0, 2] = -0.5 * steps[:, 1] - arm_y
    columns[:, 1, 2] = 0.5 * steps[:, 0] + arm_x
    columns[:, 2, 2] = 1.0
    cosine, sine = math.cos(mount[2]), math.sin(mount[2])
    into_laser = np.array(((cosine, sine, 0.0), (-sine, cosine, 0.0), (0.0, 0.0, 1.0)))
    jacobian: FloatArray = into_laser @ columns
    return jacobian


def _whitening(covariances: FloatArray) -> FloatArray:
    """(n, 3, 3) W with W^T W = covariance^-1."""
    roots: FloatArray = np.linalg.cholesky(covariances)
    inverse: FloatArray = np.linalg.inv(roots)
    return inverse


def _squared(residuals: FloatArray, covariances: FloatArray) -> FloatArray:
    white = np.einsum("nij,nj->ni", _whitening(covariances), residuals)
    squared: FloatArray = (white**2).sum(axis=1)
    return squared


def _part(components: _Components, kept: BoolArray) -> _Components:
    return _Components(components.slip[kept], components.drift[kept], components.match[kept], components.fixed[kept])


def _fit(
    residuals_at: ResidualsAt, whitening: FloatArray, kept: BoolArray, model: WheelModel, start: FloatArray, robust: bool
) -> FloatArray:
    """Gauss-Newton with fixed weights and the prior; robust while it is not known yet which steps are wrong.

    The cost itself is not looked at: along the latency it is rough, because a shifted wheel history brings other slip.
    """
    values, prior = start.copy(), model.prior
    for _ in range(DESCENTS):
        white = np.einsum("nij,nj->ni", whitening, residuals_at(values))[kept]
        jacobian = (whitening @ _jacobian(residuals_at, values, prior))[kept] * prior
        weights = 1.0 / (1.0 + np.sqrt((white**2).sum(axis=1)) / ROBUST) if robust else np.ones(len(white))
        information = np.einsum("n,nij,nik->jk", weights, jacobian, jacobian) + np.eye(len(prior))
        gradient = np.einsum("n,nij,ni->j", weights, jacobian, white) + (values - model.start) / prior
        step = np.clip(np.linalg.solve(information, gradient), -0.5, 0.5)
        values = values - step * prior
        values[-1] = np.clip(values[-1], -LATENCY_BOUND_S, LATENCY_BOUND_S)
        if np.abs(step).max() < 1e-5:
            break
    return values


def _jacobian(residuals_at: ResidualsAt, values: FloatArray, prior: FloatArray) -> FloatArray:
    """(n, 3, p) by central differences; a wide one for the latency, whose derivative is the speed and not its noise."""
    steps = 1e-4 * prior
    steps[-1] = LATENCY_STEP_S
    columns = [(residuals_at(values + move) - residuals_at(values - move)) for move in np.diag(steps)]
    jacobian: FloatArray = np.stack(columns, axis=-1) / (2.0 * steps)
    return jacobian


def _noise_cost(log_noise: FloatArray, residuals: FloatArray, components: _Components) -> float:
    """Minus the log-likelihood of the noise, with weak priors (a factor of e^3) around the start."""
    total = components.total(np.exp(log_noise))
    _, log_determinants = np.linalg.slogdet(total)
    prior = 0.5 * (((log_noise - np.log(NOISE_START)) / 3.0) ** 2).sum()
    return float(0.5 * (_squared(residuals, total) + log_determinants).sum() + prior)


def _noise(residuals: FloatArray, components: _Components, start: FloatArray) -> FloatArray:
    if len(residuals) == 0:
        return start
    bounds = [(math.log(low), math.log(high)) for low, high in NOISE_BOUNDS]
    found = minimize(_noise_cost, np.log(start), args=(residuals, components), method="L-BFGS-B", bounds=bounds)
    noise: FloatArray = np.exp(found.x)
    return noise


def _noise_log_covariance(residuals: FloatArray, components: _Components, noise: FloatArray) -> FloatArray:
    """Inverse of the Hessian of the cost, by central differences."""
    centre, step = np.log(noise), 0.05
    hessian = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            total = 0.0
            for first, second in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                moved = centre.copy()
                moved[i] += first * step
                moved[j] += second * step
                total += first * second * _noise_cost(moved, residuals, components)
            hessian[i, j] = hessian[j, i] = total / (4.0 * step**2)
    values, vectors = np.linalg.eigh(hessian)
    covariance: FloatArray = (vectors / np.maximum(values, 0.1)) @ vectors.T
    return covariance


def _covariance(
    residuals_at: ResidualsAt,
    whitening: FloatArray,
    kept: BoolArray,
    model: WheelModel,
    parameters: FloatArray,
) -> FloatArray:
    """The larger, in every direction, of the likelihood's own and the one from blocks of the drive.

    Blocks of successive steps (clustered sandwich) see errors that last longer than a step; the likelihood sees those
    that the blocks are too few to show.
    """
    prior = model.prior
    white = (whitening @ _jacobian(residuals_at, parameters, prior))[kept]
    residuals = np.einsum("nij,nj->ni", whitening, residuals_at(parameters))[kept]
    scale = 1.0 / prior  # parameters in units of their prior keep the inverse well conditioned
    information = np.einsum("nij,nik->jk", white, white) / np.outer(scale, scale) + np.eye(len(prior))
    own = np.linalg.inv(information)
    scores = np.einsum("nij,ni->nj", white, residuals) / scale
    blocks = [block.sum(axis=0) for block in np.array_split(scores, min(CLUSTERS, max(len(scores), 1)))]
    count = len(blocks)
    between = sum((np.outer(block, block) for block in blocks), np.zeros_like(own)) * count / max(count - 1, 1)
    clustered = own @ between @ own
    ratio = np.sqrt(np.maximum(1.0, np.diag(clustered) / np.diag(own)))
    covariance: FloatArray = own * np.outer(ratio, ratio) * np.outer(prior, prior)
    return covariance
