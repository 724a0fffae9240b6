"""The own linear algebra is that of numpy to rounding, and says where a matrix has no inverse."""

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.arithmetic.small_matrices import (
    applied,
    bounded_below,
    carried,
    determinant_of_three,
    eigen,
    inner,
    inverse,
    product,
    pseudo_inverse,
    squared_distance,
)

GENERATOR = np.random.default_rng(4)


def spread(size: int) -> FloatArray:
    """A positive definite matrix whose axes differ as those of poses do."""
    root = GENERATOR.standard_normal((size, size)) * 10.0 ** GENERATOR.uniform(-2.0, 1.0, size)
    return root @ root.T + 1e-4 * np.eye(size)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 40])
def test_products_inverses_and_distances_are_those_of_numpy(size: int) -> None:
    first, second, vector = GENERATOR.standard_normal((size, 5)), GENERATOR.standard_normal((5, 9)), spread(size)[0]
    matrix = spread(size)
    np.testing.assert_allclose(product(first, second), first @ second, atol=1e-12)
    np.testing.assert_allclose(product(second.T, first.T), second.T @ first.T, atol=1e-12)
    np.testing.assert_allclose(applied(first.T, vector), first.T @ vector, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(carried(first.T, matrix), first.T @ matrix @ first, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(product(inverse(matrix), matrix), np.eye(size), atol=1e-7)
    assert inner(vector, vector) == pytest.approx(float(vector @ vector))
    assert squared_distance(vector, matrix) == pytest.approx(float(vector @ np.linalg.solve(matrix, vector)), rel=1e-7)


def test_rows_are_exchanged_where_a_pivot_is_nothing() -> None:
    turned = np.array(((0.0, 2.0, 0.0), (0.0, 0.0, -4.0), (0.5, 0.0, 0.0)))
    np.testing.assert_array_equal(inverse(turned), ((0.0, 0.0, 2.0), (0.5, 0.0, 0.0), (0.0, -0.25, 0.0)))
    assert determinant_of_three(turned) == pytest.approx(np.linalg.det(turned))


def test_what_has_no_inverse_is_refused() -> None:
    flat = np.diag((1.0, 0.0, 2.0))
    with pytest.raises(np.linalg.LinAlgError, match="3 rows is singular"):
        inverse(flat)
    with pytest.raises(np.linalg.LinAlgError, match="3 rows is singular"):
        squared_distance(np.ones(3), flat)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_eigenvectors_are_orthonormal_and_give_the_matrix_again(size: int) -> None:
    for matrix in (spread(size), -spread(size), np.eye(size), np.zeros((size, size)), np.ones((size, size))):
        before = matrix.copy()
        values, vectors = eigen(matrix)
        np.testing.assert_array_equal(matrix, before)
        np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), rtol=1e-9, atol=1e-12 * np.abs(matrix).max())
        np.testing.assert_allclose(vectors.T @ vectors, np.eye(size), atol=1e-13)
        np.testing.assert_allclose(
            (vectors * values) @ vectors.T, matrix, atol=1e-12 * max(np.abs(matrix).max(), 1e-300)
        )


def test_what_is_no_number_has_no_eigenvectors() -> None:
    for wrong in (np.nan, np.inf):
        assert np.isnan(eigen(np.diag((1.0, wrong)))[1]).all()


def test_a_bound_lifts_only_what_is_below_it() -> None:
    _, vectors = eigen(spread(3))
    lifted = bounded_below((vectors * (-1e-9, 2.0, 3.0)) @ vectors.T, 1e-6)
    np.testing.assert_allclose(lifted, (vectors * (1e-6, 2.0, 3.0)) @ vectors.T, atol=1e-14)
    np.testing.assert_array_equal(lifted, lifted.T)


def test_a_pseudo_inverse_leaves_out_what_is_nothing() -> None:
    root = GENERATOR.standard_normal((3, 2))
    np.testing.assert_allclose(pseudo_inverse(root @ root.T), np.linalg.pinv(root @ root.T, hermitian=True), atol=1e-10)
    np.testing.assert_allclose(pseudo_inverse(matrix := spread(3)), np.linalg.inv(matrix), rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(pseudo_inverse(np.zeros((3, 3))), np.zeros((3, 3)))
