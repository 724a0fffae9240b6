import numpy as np
import pytest

from runtime.calibrate.dead_reckoning import seen_by_laser
from runtime.calibrate.step_errors import estimate_noise, slip_from_heading, step_errors, twist_jacobian
from runtime.calibrate.wheel_model import DifferentialModel
from slam.pose import composed
from tests.support.runtime.made_drives import START, Rover, made_motion, weaving


def _step(distance: float, sideways: float, turn: float) -> np.ndarray:
    """A body's motion in 400 pieces; sideways is added in the middle."""
    pose = np.zeros((1, 3))
    for piece in range(400):
        if piece == 200:
            pose = composed(pose, np.array([(0.0, sideways, 0.0)]))
        pose = composed(pose, np.array([(distance / 400, 0.0, turn / 400)]))
    return pose


@pytest.mark.parametrize("turn", [0.0, 0.3, -0.4])
def test_the_jacobian_of_a_step_is_what_its_parts_do(turn: float) -> None:
    mount, size = np.array((0.3, 0.1, 0.4)), 1e-4
    jacobian = twist_jacobian(_step(0.5, 0.0, turn), mount)[0]
    for column, change in enumerate(np.eye(3) * size):
        moved = seen_by_laser(_step(0.5 + change[0], change[1], turn + change[2]), mount)
        back = seen_by_laser(_step(0.5 - change[0], -change[1], turn - change[2]), mount)
        np.testing.assert_allclose(((moved - back) / (2.0 * size))[0], jacobian[:, column], atol=0.02)


def test_noise_is_told_from_residuals_that_have_it() -> None:
    model, rng = DifferentialModel(START), np.random.default_rng(5)
    errors = step_errors([made_motion(weaving(400.0), Rover(), rng)], model, model.start)
    noise = np.array((0.008, 0.02, 1.5))
    roots = np.linalg.cholesky(errors.total(noise))
    residuals = np.einsum("nij,nj->ni", roots, rng.standard_normal((len(roots), 3)))
    np.testing.assert_allclose(estimate_noise(residuals, errors, np.array((0.01, 0.005, 1.0))), noise, rtol=0.15)
    slip, low, high = slip_from_heading(residuals, errors, noise)
    assert low < 0.008 < high
    assert low < slip < high


def test_the_interval_of_the_slip_reaches_to_zero_where_there_is_none() -> None:
    model, rng = DifferentialModel(START), np.random.default_rng(4)
    motion = made_motion(weaving(60.0), Rover(slip=0.0), rng, match_m=0.01, match_rad=0.002)
    errors = step_errors([motion], model, model.start)
    residuals = 0.002 * rng.standard_normal((len(motion.means), 3))
    assert slip_from_heading(residuals, errors, np.array((0.001, 0.001, 1.0)))[1] == 0.0
