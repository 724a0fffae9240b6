import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from slam.pose import Pose2, composed, inverted, rotated, wrap_rad, wrap_rads

metres = st.floats(-1e4, 1e4)
angles = st.floats(-50.0, 50.0)
poses = st.builds(Pose2, metres, metres, st.floats(-math.pi, math.pi))


def same(a: Pose2, b: Pose2) -> bool:
    return (
        math.isclose(a.x_m, b.x_m, abs_tol=1e-7)
        and math.isclose(a.y_m, b.y_m, abs_tol=1e-7)
        and abs(wrap_rad(a.heading_rad - b.heading_rad)) < 1e-9
    )


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert same((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_a_pose_and_its_inverse_cancel(a: Pose2) -> None:
    assert same(a @ a.inverse(), Pose2())
    assert same(a.inverse() @ a, Pose2())


@given(poses, poses, metres, metres)
def test_transforming_by_a_product_is_transforming_twice(a: Pose2, b: Pose2, x: float, y: float) -> None:
    point = np.array([[x, y]])
    np.testing.assert_allclose((a @ b).transform(point), a.transform(b.transform(point)), atol=1e-6)


@given(angles)
def test_a_wrapped_angle_is_in_range_and_points_the_same_way(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)
    assert wrap_rads(np.array([angle]))[0] == wrapped


def test_half_a_turn_either_way_is_plus_pi() -> None:
    assert wrap_rad(math.pi) == math.pi
    assert wrap_rad(-math.pi) == math.pi


def test_rows_of_poses_compose_as_single_ones_do() -> None:
    generator = np.random.default_rng(0)
    outer, inner = generator.normal(size=(2, 20, 3))
    rows = composed(outer, inner)
    one_by_one = [(Pose2(*a) @ Pose2(*b)).as_array() for a, b in zip(outer.tolist(), inner.tolist(), strict=True)]
    np.testing.assert_allclose(rows[:, :2], np.array(one_by_one)[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrap_rads(rows[:, 2]), np.array(one_by_one)[:, 2], atol=1e-12)
    np.testing.assert_allclose(composed(outer, inverted(outer)), np.zeros((20, 3)), atol=1e-12)


def test_vectors_turn_all_alike_or_each_by_its_own_angle() -> None:
    vectors, angles = np.array(((1.0, 0.0), (0.0, 2.0))), np.array((np.pi / 2.0, -np.pi / 2.0))
    np.testing.assert_allclose(rotated(vectors, np.pi / 2.0), ((0.0, 1.0), (-2.0, 0.0)), atol=1e-12)
    np.testing.assert_allclose(rotated(vectors, angles), ((0.0, 1.0), (2.0, 0.0)), atol=1e-12)
