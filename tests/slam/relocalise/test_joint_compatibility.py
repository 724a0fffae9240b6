import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.relocalise.joint_compatibility import chi_square_999, condition_on_matches

SIGMA_M = 0.1
COVARIANCE = np.diag(np.tile((0.3**2, 0.2**2), 12))


def gaps_of(offsets: FloatArray) -> FloatArray:
    """Means (24,) of six pairs of points that are off each other."""
    first = np.arange(12.0).reshape(6, 2)
    return np.vstack((first, first + offsets)).ravel()


def equal(at: FloatArray, kept: list[int]) -> tuple[FloatArray, FloatArray]:
    values, slopes = np.zeros(2 * len(kept)), np.zeros((2 * len(kept), len(at)))
    for row, pair in enumerate(kept):
        two, first, second = (slice(2 * number, 2 * number + 2) for number in (row, pair, 6 + pair))
        values[two] = at[second] - at[first]
        slopes[two, first], slopes[two, second] = -np.eye(2), np.eye(2)
    return values, slopes


def test_matches_that_agree_are_all_kept_and_meet_in_the_middle() -> None:
    mean = gaps_of(np.full((6, 2), 0.2))
    found = condition_on_matches(mean, COVARIANCE, equal, 6, SIGMA_M, 0, 4)
    assert found is not None
    assert found.kept == list(range(6))
    middle = 0.5 * (mean[:12] + mean[12:])
    assert np.allclose(0.5 * (found.mean[:12] + found.mean[12:]), middle)
    assert (np.abs(found.mean[12:] - found.mean[:12]) < 0.05).all()
    assert (np.diag(found.covariance) < np.diag(COVARIANCE)).all()
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


@pytest.mark.parametrize(("wrong", "kept"), [([2], [0, 1, 3, 4, 5]), ([1, 4], [0, 2, 3, 5])])
def test_wrong_matches_are_dropped(wrong: list[int], kept: list[int]) -> None:
    offsets = np.zeros((6, 2))
    offsets[wrong] = (3.0, -2.0)
    found = condition_on_matches(gaps_of(offsets), COVARIANCE, equal, 6, SIGMA_M, 0, 4)
    assert found is not None
    assert found.kept == kept
    assert found.square <= chi_square_999(found.freedom)


def test_more_than_a_third_of_wrong_matches_is_a_wrong_place() -> None:
    offsets = np.zeros((6, 2))
    offsets[:3] = ((3.0, -2.0), (-3.0, 1.0), (2.0, 3.0))
    assert condition_on_matches(gaps_of(offsets), COVARIANCE, equal, 6, SIGMA_M, 0, 1) is None


def test_the_bound_is_the_quantile() -> None:
    assert [round(chi_square_999(freedom), 1) for freedom in (2, 5, 21)] == pytest.approx([13.8, 20.5, 46.8], abs=0.3)
