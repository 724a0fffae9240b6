from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from runtime.calibrate.solve import _Steps, solve
from runtime.calibrate.wheel_model import MOUNT_NAMES, DifferentialModel
from tests.support.runtime.made_drives import START, Rover, made_motion, random_rover, weaving

MODEL = DifferentialModel(START)


def test_without_noise_every_parameter_is_found() -> None:
    rng = np.random.default_rng(8)
    rover = replace(random_rover(rng), slip=0.0)
    solution = solve([made_motion(weaving(60.0), rover, rng, 1e-6, 1e-7)], MODEL)
    # a count is 0.2 mm, a scan lies somewhere between two samples
    np.testing.assert_allclose(solution.parameters[:3], rover.values[:3], rtol=1e-3)
    np.testing.assert_allclose(solution.parameters[3:], rover.values[3:], atol=1e-3)


def test_intervals_hold_the_truth() -> None:
    path, scores = weaving(60.0), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        rover = random_rover(rng)
        solution = solve([made_motion(path, rover, rng)], MODEL)
        error = solution.parameters - rover.values
        scores.append(np.abs(error) / np.sqrt(np.diag(solution.covariance)) < 1.96)
    assert np.mean(scores) > 0.88  # 84 intervals


def test_slip_widens_the_tread_less_than_its_square_would() -> None:
    path, errors = weaving(60.0), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        rover = replace(random_rover(rng), slip=0.02)
        errors.append(solve([made_motion(path, rover, rng)], MODEL).parameters[2] / rover.tread_m - 1.0)
    # derivatives from the slipping wheels themselves give +1.6 %
    assert abs(np.mean(errors)) < 0.012


def test_steps_that_do_not_fit_are_left_out() -> None:
    rng = np.random.default_rng(9)
    rover = Rover()
    motion = made_motion(weaving(60.0), rover, rng)
    motion.means[10:13] += (0.3, 0.2, 0.2)
    solution = solve([motion], MODEL)
    assert np.flatnonzero(~solution.kept).tolist() == [10, 11, 12]
    score = (solution.parameters - rover.values) / np.sqrt(np.diag(solution.covariance))
    assert np.abs(score).max() < 4.0


def test_a_latency_of_seconds_is_not_found_but_held_at_the_bound() -> None:
    rng = np.random.default_rng(10)
    solution = solve([made_motion(weaving(60.0), Rover(latency_s=3.0), rng)], MODEL)
    assert abs(solution.parameters[-1]) <= 0.5


def test_a_derivative_by_mount_or_latency_does_not_ask_for_the_wheels_account_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    motion = made_motion(weaving(60.0), Rover(), np.random.default_rng(11))
    counted = Mock(side_effect=DifferentialModel.dead_reckoning, autospec=True)
    monkeypatch.setattr(DifferentialModel, "dead_reckoning", lambda *given: counted(*given))
    _Steps([motion], [motion], MODEL).jacobian(MODEL.start)
    assert counted.call_count == 1 + 2 * (len(MODEL.names) - len(MOUNT_NAMES))
