import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import FloatArray
from runtime.evaluate.errors import in_start_frame, position_error, rigid_fit, squared_pose_errors, trajectory_error
from slam.pose import Pose2, wrap_rads

metres = st.floats(-100.0, 100.0)
headings = st.floats(-3.1, 3.1)
SCATTERED: FloatArray = np.random.default_rng(0).normal(size=(50, 3)) * np.array([30.0, 20.0, 1.0])


def moved(poses: FloatArray, by: Pose2) -> FloatArray:
    return np.column_stack((by.transform(poses[:, :2]), wrap_rads(poses[:, 2] + by.heading_rad)))


@pytest.fixture
def path() -> FloatArray:
    return SCATTERED.copy()


@given(x=metres, y=metres, heading=headings)
def test_neither_error_depends_on_the_choice_of_frame(x: float, y: float, heading: float) -> None:
    error = trajectory_error(moved(SCATTERED, Pose2(x, y, heading)), SCATTERED)
    assert error.from_start.largest_m == pytest.approx(0.0, abs=1e-9)
    assert error.aligned.rms_m == pytest.approx(0.0, abs=1e-9)


def test_a_heading_lost_at_the_start_is_gone_after_the_fit(path: FloatArray) -> None:
    estimated = in_start_frame(path)
    estimated = moved(estimated, Pose2(0.0, 0.0, 0.01))
    estimated[0] = 0.0
    error = trajectory_error(estimated, path)
    farthest = np.hypot(*in_start_frame(path)[:, :2].T).max()
    assert error.from_start.largest_m == pytest.approx(0.01 * farthest, rel=1e-3)
    assert error.aligned.largest_m < 1e-6


@given(x=metres, y=metres, heading=headings)
def test_the_fit_finds_the_motion_that_was_applied(x: float, y: float, heading: float) -> None:
    points = np.random.default_rng(1).normal(size=(20, 2)) * 10.0
    fit = rigid_fit(points, Pose2(x, y, heading).transform(points))
    assert np.allclose(fit.transform(points), Pose2(x, y, heading).transform(points), atol=1e-9)


def test_the_trimmed_error_leaves_out_the_worst_twentieth() -> None:
    true = np.zeros((100, 2))
    estimated = np.full((100, 2), 0.0)
    estimated[:, 0] = 1.0
    estimated[:5, 0] = 100.0
    error = position_error(estimated, true)
    assert (error.largest_m, error.trimmed_rms_m) == (100.0, 1.0)
    assert error.rms_m == pytest.approx(np.sqrt(0.95 + 0.05 * 1e4))


def test_squared_pose_errors_average_to_three_when_the_covariance_is_right() -> None:
    generator = np.random.default_rng(2)
    root = generator.normal(size=(3, 3)) * 0.1
    errors = generator.standard_normal((4000, 3)) @ root.T
    true = generator.normal(size=(4000, 3))
    values = squared_pose_errors(true + errors, np.tile(root @ root.T, (4000, 1, 1)), true)
    assert values.mean() == pytest.approx(3.0, abs=0.2)


def test_a_pose_without_uncertainty_has_no_squared_error() -> None:
    values = squared_pose_errors(np.zeros((2, 3)), np.stack((np.zeros((3, 3)), np.eye(3))), np.zeros((2, 3)))
    assert np.isnan(values[0])
    assert values[1] == 0.0


def test_paths_of_different_length_are_refused(path: FloatArray) -> None:
    with pytest.raises(ValueError, match="shape"):
        trajectory_error(path[:-1], path)
