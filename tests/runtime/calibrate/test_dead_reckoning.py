import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.calibrate.dead_reckoning import chord, dead_reckoning, moved, seen_by_laser
from slam.pose import Pose2, composed, inverted

COORDINATE = st.floats(-20.0, 20.0)
ANGLE = st.floats(-3.0, 3.0)
POSE = st.tuples(COORDINATE, COORDINATE, ANGLE)


@given(POSE, POSE)
def test_composition_is_that_of_pose2(first: tuple[float, float, float], second: tuple[float, float, float]) -> None:
    rows = composed(np.array([first]), np.array([second]))[0]
    pose = Pose2(*first) @ Pose2(*second)
    np.testing.assert_allclose(rows[:2], (pose.x_m, pose.y_m), atol=1e-9)
    np.testing.assert_allclose(np.cos(rows[2]), np.cos(pose.heading_rad), atol=1e-9)


@given(POSE)
def test_inverse_undoes_a_pose(pose: tuple[float, float, float]) -> None:
    row = np.array([pose])
    np.testing.assert_allclose(composed(row, inverted(row)), np.zeros((1, 3)), atol=1e-9)


@given(st.floats(-2.0, 2.0), st.floats(-2e-4, 2e-4))
def test_nearly_straight_arcs_join_the_exact_ones(distance: float, turn: float) -> None:
    ahead, left = chord(np.array([distance]), np.array([turn]))
    np.testing.assert_allclose((ahead[0], left[0]), (distance, distance * turn / 2.0), atol=1e-7)


def test_a_circle_closes() -> None:
    turns = np.linspace(0.0, 2.0 * np.pi, 50)
    circle = dead_reckoning(np.linspace(0.0, 10.0, 50), 3.0 * turns, turns)
    np.testing.assert_allclose(circle.poses[-1, :2], (0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(np.hypot(circle.poses[:, 0], circle.poses[:, 1] - 3.0), 3.0)


def test_a_pose_between_two_samples_lies_on_the_arc() -> None:
    circle = dead_reckoning(np.array((0.0, 1.0)), np.array((0.0, 3.0)), np.array((0.0, 1.0)))
    between = circle.at(np.array((0.25, 2.0)))
    np.testing.assert_allclose(between[0], moved(np.zeros((1, 3)), np.array([0.75]), np.array([0.25]))[0])
    np.testing.assert_allclose(between[1], circle.poses[-1])


def test_a_laser_ahead_of_the_axle_swings_sideways_when_the_body_turns() -> None:
    step = seen_by_laser(np.array([(0.0, 0.0, 0.1)]), np.array((1.0, 0.0, 0.0)))[0]
    np.testing.assert_allclose(step, (np.cos(0.1) - 1.0, np.sin(0.1), 0.1))
