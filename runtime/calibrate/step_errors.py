"""How wrong a step's prediction may be: covariance by causes, and the size of each cause from the residuals."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from drivers.measurements import BoolArray, FloatArray
from runtime.calibrate.dead_reckoning import DeadReckoning, chord, seen_by_laser
from runtime.calibrate.scans.laser_motion import LaserMotion
from runtime.calibrate.wheel_model import WheelModel
from slam.pose import composed, inverted

NOISE_START = (0.01, 0.005, 1.0)  # slip and drift m per sqrt(m), factor on the matching deviation
NOISE_BOUNDS = ((1e-5, 0.5), (1e-5, 0.5), (0.3, 20.0))
PROFILE_LIMIT = 0.5 * 3.84  # chi-squared, one degree of freedom, 95 %
BISECTIONS = 14
HEADING_PARAMETERS = 4  # radii over tread, and latency, are fitted to the heading too


@dataclass(frozen=True, slots=True, eq=False)
class StepErrors:
    """Covariance of each step = slip^2 * slip + drift^2 * drift + factor^2 * match + fixed, (n, 3, 3) each.

    by_error (n, 3, 2): what a metre of each wheel error does to the laser's motion; weights (n, 2): metres by which its
    variance grows.
    """

    slip: FloatArray
    drift: FloatArray
    match: FloatArray
    fixed: FloatArray
    by_error: FloatArray
    weights: FloatArray

    def total(self, noise: FloatArray) -> FloatArray:
        """(n, 3, 3) for noise (3,): slip, drift, factor."""
        slip, drift, factor = noise**2
        total: FloatArray = slip * self.slip + drift * self.drift + factor * self.match + self.fixed
        return total

    def part(self, kept: BoolArray) -> "StepErrors":
        """Those of some steps."""
        return StepErrors(*(getattr(self, field.name)[kept] for field in fields(self)))

    def likely(self, noise: FloatArray, residuals: FloatArray) -> FloatArray:
        """Wheel errors (n, 2) in m that the residuals (n, 3) speak of: their mean given wheels and laser."""
        explained = np.linalg.solve(self.total(noise), residuals[..., None])[..., 0]
        errors: FloatArray = noise[0] ** 2 * self.weights * np.einsum("nie,ni->ne", self.by_error, explained)
        return errors


def body_steps(
    motion: LaserMotion, model: WheelModel, parameters: FloatArray, wheels: DeadReckoning | None = None
) -> FloatArray:
    """Motion (n, 3) of the body in every step as the wheels tell it. wheels: the model's own, where they are known."""
    wheels = wheels or model.dead_reckoning(motion.series, parameters)
    poses = wheels.at(motion.times_s.ravel() - parameters[-1]).reshape(-1, 2, 3)
    return composed(inverted(poses[:, 0]), poses[:, 1])


def laser_steps(
    motion: LaserMotion, model: WheelModel, parameters: FloatArray, wheels: DeadReckoning | None = None
) -> FloatArray:
    """The same for the laser."""
    return seen_by_laser(body_steps(motion, model, parameters, wheels), parameters[-4:-1])


def step_errors(motions: Sequence[LaserMotion], model: WheelModel, parameters: FloatArray) -> StepErrors:
    """For all steps of all drives, one after the other."""
    return _joined([_drive_errors(motion, model, parameters) for motion in motions])


def _joined(parts: Sequence[StepErrors]) -> StepErrors:
    return StepErrors(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(StepErrors)))


def _drive_errors(motion: LaserMotion, model: WheelModel, parameters: FloatArray) -> StepErrors:
    arms = model.noise_arms(parameters)
    steps = body_steps(motion, model, parameters)
    times = motion.times_s.ravel() - parameters[-1]
    weights = np.diff(model.noise_weights(motion.series, parameters, times).reshape(-1, 2, 2), axis=1)[:, 0]
    by_motion = twist_jacobian(steps, parameters[-4:-1])
    by_error = by_motion[:, :, (0, 2)] @ arms.T
    across = by_motion[:, :, 1, None] * by_motion[:, None, :, 1]
    # slip that happens along the way, not in its middle, also carries sideways
    turned = (weights * arms[:, 1] ** 2).sum(axis=1) * (steps[:, 0] ** 2 + steps[:, 1] ** 2) / 12.0
    return StepErrors(
        np.einsum("nie,ne,nje->nij", by_error, weights, by_error) + turned[:, None, None] * across,
        weights.mean(axis=1)[:, None, None] * across,
        motion.covariances,
        model.quantisation_m2(parameters) * by_error @ by_error.transpose(0, 2, 1),
        by_error,
        weights,
    )


def twist_jacobian(steps: FloatArray, mount: FloatArray) -> FloatArray:
    """(n, 3, 3): columns are what a metre more ahead, a metre sideways and a radian more do to the laser's motion.

    steps (n, 3): motion of the body; mount (3,): body_from_laser. A heading error in the middle of the way turns its
    second half.
    """
    turn = steps[:, 2]
    ahead, left = chord(np.ones_like(turn), turn)
    columns = np.zeros((len(steps), 3, 3))
    columns[:, 0, 0], columns[:, 1, 0] = ahead, left
    columns[:, 0, 1], columns[:, 1, 1] = -np.sin(0.5 * turn), np.cos(0.5 * turn)
    arm_x = np.cos(turn) * mount[0] - np.sin(turn) * mount[1]
    arm_y = np.sin(turn) * mount[0] + np.cos(turn) * mount[1]
    columns[:, 0, 2] = -0.5 * steps[:, 1] - arm_y
    columns[:, 1, 2] = 0.5 * steps[:, 0] + arm_x
    columns[:, 2, 2] = 1.0
    cosine, sine = math.cos(mount[2]), math.sin(mount[2])
    into_laser = np.array(((cosine, sine, 0.0), (-sine, cosine, 0.0), (0.0, 0.0, 1.0)))
    jacobian: FloatArray = into_laser @ columns
    return jacobian


def whitening(covariances: FloatArray) -> FloatArray:
    """(n, 3, 3) W with W^T W = covariance^-1."""
    inverse: FloatArray = np.linalg.inv(np.linalg.cholesky(covariances))
    return inverse


def squared(residuals: FloatArray, covariances: FloatArray) -> FloatArray:
    """(n,) squared Mahalanobis lengths."""
    lengths: FloatArray = (np.einsum("nij,nj->ni", whitening(covariances), residuals) ** 2).sum(axis=1)
    return lengths


def estimate_noise(residuals: FloatArray, errors: StepErrors, start: FloatArray) -> FloatArray:
    """Slip, drift and factor (3,) of greatest likelihood."""
    if len(residuals) == 0:
        return start
    bounds = [(math.log(low), math.log(high)) for low, high in NOISE_BOUNDS]
    found = minimize(_cost, np.log(start), args=(residuals, errors), method="L-BFGS-B", bounds=bounds)
    noise: FloatArray = np.exp(found.x)
    return noise


def slip_from_heading(residuals: FloatArray, errors: StepErrors, noise: FloatArray) -> tuple[float, float, float]:
    """Slip of greatest likelihood and its 95 % interval, m per sqrt(m), from the heading alone.

    Matching is a hundred times better than the wheels in heading but no better in distance, where its own errors, which
    are not Gaussian, pass for slip (one interval in five missed the truth in simulation).
    """
    grown = (errors.weights * errors.by_error[:, 2] ** 2).sum(axis=1)
    other = noise[2] ** 2 * errors.match[:, 2, 2] + errors.fixed[:, 2, 2]
    count = len(residuals)
    squares = residuals[:, 2] ** 2 * count / max(count - HEADING_PARAMETERS, 1)

    def cost(log_slip: float) -> float:
        variance = np.exp(2.0 * log_slip) * grown + other
        return float(0.5 * (squares / variance + np.log(variance)).sum())

    low, high = (math.log(bound) for bound in NOISE_BOUNDS[0])
    best = float(minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-4}).x)
    limit = cost(best) + PROFILE_LIMIT
    lower, upper = _crossing(cost, limit, best, low), _crossing(cost, limit, best, high)
    return math.exp(best), 0.0 if lower <= low else math.exp(lower), math.exp(upper)


def most_drift(residuals: FloatArray, errors: StepErrors, noise: FloatArray) -> float:
    """Upper bound (95 %) of the sideways drift, m per sqrt(m): errors of matching pass for drift too."""

    def cost(log_drift: float) -> float:
        return _cost(np.log((noise[0], math.exp(log_drift), noise[2])), residuals, errors)

    best = math.log(noise[1])
    return math.exp(_crossing(cost, cost(best) + PROFILE_LIMIT, best, math.log(NOISE_BOUNDS[1][1])))


def _crossing(cost: Callable[[float], float], limit: float, inside: float, outside: float) -> float:
    """Where the cost passes the limit between the two, or `outside` if it does not."""
    if cost(outside) <= limit:
        return outside
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if cost(middle) <= limit else (inside, middle)
    return inside


def _cost(log_noise: FloatArray, residuals: FloatArray, errors: StepErrors) -> float:
    """Minus the log-likelihood of the noise. Substitution by hand: this runs thousands of times on 3 x 3."""
    roots = np.linalg.cholesky(errors.total(np.exp(log_noise)))
    first = residuals[:, 0] / roots[:, 0, 0]
    second = (residuals[:, 1] - roots[:, 1, 0] * first) / roots[:, 1, 1]
    third = (residuals[:, 2] - roots[:, 2, 0] * first - roots[:, 2, 1] * second) / roots[:, 2, 2]
    diagonal = roots[:, (0, 1, 2), (0, 1, 2)]
    return float(0.5 * (first @ first + second @ second + third @ third) + np.log(diagonal).sum())
