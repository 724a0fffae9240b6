"""Maximum likelihood of the parameters, given what wheels and laser say of the same steps.

Residual of a step: motion of the laser that the wheels and the parameters predict, minus the one that matching found.
Slip, sideways drift and the size of the matching error are estimated together with the rest, so nothing has to be known
beforehand. The wheels are the noisier side, and noise in what a parameter multiplies pulls that parameter away (a tread
1 % too wide in simulation): derivatives are therefore taken from the wheel history with its most likely slip removed.
Along the latency the cost is rough, because a shifted history brings other slip: the equation is solved, the cost is
not looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from runtime.calibrate.dead_reckoning import DeadReckoning
from runtime.calibrate.scans.laser_motion import LaserMotion
from runtime.calibrate.step_errors import (
    NOISE_START,
    StepErrors,
    estimate_noise,
    laser_steps,
    most_drift,
    slip_from_heading,
    squared,
    step_errors,
    whitening,
)
from runtime.calibrate.wheel_model import MOUNT_NAMES, WheelModel

LATENCY_BOUND_S = 0.5  # beyond it is no latency but a fault of the clocks
LATENCY_STEP_S = 0.1  # the derivative along the latency is the mean speed of so long to either side
GATE = 21.1  # chi-squared, 3 degrees of freedom: one good step in ten thousand is left out
ROUNDS, ROBUST_ROUNDS, DESCENTS = 10, 2, 8
ROBUST = 2.5
LARGEST_STEP = 0.5  # of the prior's deviation, in one descent
BLOCKS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """parameters (p,) and covariance (p, p); noise (3,): slip, drift, factor.

    residuals (n, 3) of all steps and what they may be; kept (n,): those used.
    """

    parameters: FloatArray
    covariance: FloatArray
    noise: FloatArray
    residuals: FloatArray
    kept: BoolArray
    errors: StepErrors

    def slip(self) -> tuple[float, float, float]:
        """Slip of each wheel and its 95 % interval, m per sqrt(m)."""
        return slip_from_heading(self.residuals[self.kept], self.errors.part(self.kept), self.noise)

    def most_drift(self) -> float:
        """Upper bound (95 %) of the sideways drift, m per sqrt(m)."""
        return most_drift(self.residuals[self.kept], self.errors.part(self.kept), self.noise)


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """All steps of all drives; slipless: the same with the wheels' likely errors removed."""

    motions: Sequence[LaserMotion]
    slipless: Sequence[LaserMotion]
    model: WheelModel

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n, 3) predicted minus matched."""
        parts = [laser_steps(motion, self.model, values) - motion.means for motion in self.motions]
        difference = np.concatenate(parts)
        difference[:, 2] = np.mod(difference[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        return difference

    def jacobian(self, values: FloatArray) -> FloatArray:
        """(n, 3, p) by central differences."""
        sizes = 1e-4 * self.model.prior
        sizes[-1] = LATENCY_STEP_S
        # what mount and latency change does not change the wheels' own account
        known = [self.model.dead_reckoning(motion.series, values) for motion in self.slipless]
        of_wheels = len(values) - len(MOUNT_NAMES)
        columns = []
        for parameter, move in enumerate(np.diag(sizes)):
            wheels = known if parameter >= of_wheels else [None] * len(known)
            columns.append(self._slipless_steps(values + move, wheels) - self._slipless_steps(values - move, wheels))
        jacobian: FloatArray = np.stack(columns, axis=-1) / (2.0 * sizes)
        return jacobian

    def _slipless_steps(self, values: FloatArray, wheels: Sequence[DeadReckoning | None]) -> FloatArray:
        parts = zip(self.slipless, wheels, strict=True)
        return np.concatenate([laser_steps(motion, self.model, values, known) for motion, known in parts])

    def without_slip(self, values: FloatArray, errors: StepErrors, noise: FloatArray, kept: BoolArray) -> "_Steps":
        """Once more, with the errors that are likely now."""
        likely = errors.likely(noise, self.residuals(values)) * kept[:, None]
        ends = np.cumsum([len(motion.means) for motion in self.motions])[:-1]
        slipless = []
        for motion, slips in zip(self.motions, np.split(likely, ends), strict=True):
            series = self.model.without_errors(motion.series, values, motion.times_s - values[-1], slips)
            slipless.append(replace(motion, series=series))
        return _Steps(self.motions, slipless, self.model)


def solve(motions: Sequence[LaserMotion], model: WheelModel) -> Solution:
    """Alternate between parameters, noise and outliers until the same steps stay in use."""
    if not any(len(motion.means) for motion in motions):
        return _nothing(motions, model)
    steps = _Steps(motions, motions, model)
    values, noise = model.start.copy(), np.array(NOISE_START)
    kept = np.ones(sum(len(motion.means) for motion in motions), dtype=np.bool_)
    errors = step_errors(motions, model, values)
    for turn in range(ROUNDS):
        robust = turn < ROBUST_ROUNDS
        before = values
        values = _descend(steps, whitening(errors.total(noise)), kept, values, robust)
        residuals = steps.residuals(values)
        errors = step_errors(motions, model, values)
        noise = estimate_noise(residuals[kept], errors.part(kept), noise)
        still = squared(residuals, errors.total(noise)) < GATE
        settled = np.array_equal(still, kept) and bool((np.abs(values - before) < 0.01 * model.prior).all())
        if not robust:
            steps = steps.without_slip(values, errors, noise, still)
            if settled and turn > ROBUST_ROUNDS:
                break
        kept = still
    return Solution(
        values,
        _covariance(steps, whitening(errors.total(noise)), kept, values),
        noise,
        residuals,
        kept,
        errors,
    )


def _nothing(motions: Sequence[LaserMotion], model: WheelModel) -> Solution:
    """Without a single step all stays as it was believed."""
    errors = step_errors(motions, model, model.start)
    covariance = np.diag(model.prior**2)
    noise, none = np.array(NOISE_START), np.zeros(0, dtype=np.bool_)
    return Solution(model.start, covariance, noise, np.zeros((0, 3)), none, errors)


def _descend(steps: _Steps, whiten: FloatArray, kept: BoolArray, start: FloatArray, robust: bool) -> FloatArray:
    """Gauss-Newton with fixed weights and the prior; robust while it is not known yet which steps are wrong."""
    values, model = start.copy(), steps.model
    for _ in range(DESCENTS):
        white = np.einsum("nij,nj->ni", whiten, steps.residuals(values))[kept]
        jacobian = (whiten @ steps.jacobian(values))[kept] * model.prior
        weights = 1.0 / (1.0 + np.sqrt((white**2).sum(axis=1)) / ROBUST) if robust else np.ones(len(white))
        information = np.einsum("n,nij,nik->jk", weights, jacobian, jacobian) + np.eye(len(values))
        gradient = np.einsum("n,nij,ni->j", weights, jacobian, white) + (values - model.start) / model.prior
        step = np.clip(np.linalg.solve(information, gradient), -LARGEST_STEP, LARGEST_STEP)
        values = values - step * model.prior
        values[-1] = np.clip(values[-1], -LATENCY_BOUND_S, LATENCY_BOUND_S)
        if np.abs(step).max() < 1e-4:
            break
    return values


def _covariance(steps: _Steps, whiten: FloatArray, kept: BoolArray, values: FloatArray) -> FloatArray:
    """The likelihood's own covariance, widened where blocks of successive steps differ by more than it allows.

    The blocks (clustered sandwich) see errors that last longer than a step; they are too few to narrow anything.
    """
    prior = steps.model.prior
    white = (whiten @ steps.jacobian(values))[kept] * prior
    residuals = np.einsum("nij,nj->ni", whiten, steps.residuals(values))[kept]
    own = np.linalg.inv(np.einsum("nij,nik->jk", white, white) + np.eye(len(prior)))
    scores = np.einsum("nij,ni->nj", white, residuals)
    blocks = np.array([block.sum(axis=0) for block in np.array_split(scores, min(BLOCKS, max(len(scores), 1)))])
    between = blocks.T @ blocks * len(blocks) / max(len(blocks) - 1, 1)
    clustered = own @ between @ own
    ratio = np.sqrt(np.maximum(1.0, np.diag(clustered) / np.diag(own)))
    covariance: FloatArray = own * np.outer(ratio * prior, ratio * prior)
    return covariance
