"""The unscented transform and the angles it is made with."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.angles import angle_between, cosine_sine_of_step, wrapped
from slam.settings.sigma_points import unscented_weights
from slam.unscented import pose_root_into
from tests.support.slam.unscented import square_root, unscented_transform

ANGLES = st.floats(-50.0, 50.0)


@given(st.integers(1, 9), st.floats(0.01, 2.0), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_mean_weights_sum_to_one(dimension: int, alpha: float, beta: float, kappa: float) -> None:
    weights = unscented_weights(dimension, alpha, beta, kappa)
    assert weights.mean_centre + 2 * dimension * weights.other == pytest.approx(1.0, abs=1e-6 / alpha**2)


def test_the_covariance_weight_is_the_standard_one_and_not_the_printed_one() -> None:
    weights = unscented_weights(5, alpha=0.5, beta=2.0, kappa=0.0)
    assert weights.covariance_centre - weights.mean_centre == pytest.approx(1.0 - 0.25 + 2.0)


def test_a_linear_function_is_transformed_exactly() -> None:
    generator = np.random.default_rng(0)
    matrix, root = generator.normal(size=(2, 5)), generator.normal(size=(5, 5))
    covariance, mean = root @ root.T, generator.normal(size=5)
    image_mean, image_covariance, cross = unscented_transform(mean, covariance, lambda x: matrix @ x)
    np.testing.assert_allclose(image_mean, matrix @ mean, atol=1e-12)
    np.testing.assert_allclose(image_covariance, matrix @ covariance @ matrix.T, atol=1e-10)
    np.testing.assert_allclose(cross, covariance @ matrix.T, atol=1e-10)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(0, 5))
def test_the_square_root_of_any_semidefinite_matrix_squares_to_it(seed: int, size: int, rank: int) -> None:
    factor = np.random.default_rng(seed).normal(size=(size, min(rank, size)))
    covariance = factor @ factor.T
    root = square_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-6 * max(1.0, float(np.trace(covariance))))
    assert np.array_equal(root, np.tril(root))


@given(ANGLES)
def test_wrapping_keeps_the_direction_and_ends_in_one_turn(angle: float) -> None:
    result = wrapped(angle)
    assert -math.pi < result <= math.pi
    assert math.cos(result - angle) == pytest.approx(1.0, abs=1e-12)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi + 1e-9, math.pi), st.floats(0.01, 100), st.floats(0.01, 100))
def test_the_angle_between_two_vectors_is_the_turn_from_one_to_the_other(
    start: float, turn: float, first: float, second: float
) -> None:
    end = start + turn
    angle = angle_between(
        first * math.cos(start), first * math.sin(start), second * math.cos(end), second * math.sin(end)
    )
    assert wrapped(angle - turn) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-0.5, 0.5))
def test_the_short_series_agree_with_the_library(angle: float) -> None:
    cosine, sine = cosine_sine_of_step(angle)
    assert cosine == pytest.approx(math.cos(angle), abs=1e-14)
    assert sine == pytest.approx(math.sin(angle), abs=1e-14)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_the_root_of_a_pose_covariance_is_that_of_any_matrix_to_the_last_bit(rank: int) -> None:
    generator = np.random.default_rng(rank)
    for _ in range(50):
        columns = generator.normal(size=(3, rank)) * (0.1, 0.02, 0.003)[:rank]
        covariance = columns @ columns.T if rank else np.zeros((3, 3))
        written_out = np.full((3, 3), np.nan)
        pose_root_into(covariance, written_out)
        np.testing.assert_array_equal(written_out, square_root(covariance))
