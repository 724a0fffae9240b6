"""What of a front end's features the filters use."""

import math

import numpy as np
import pytest

from slam.observations import LASTING_M, LEAST_STEP_M, Features, MatchVerdict, as_repeated, usable_rows, verdicts_of_all

COUNT = 6


def features() -> Features:
    unknown = np.full(COUNT, -1)
    return Features(
        0,
        np.linspace(10.0, 5.0, COUNT),
        np.linspace(-1.0, 1.0, COUNT),
        np.tile(np.diag((0.01, 0.0004)), (COUNT, 1, 1)),
        np.ones(COUNT, dtype=np.bool_),
        unknown,
        unknown,
    )


@pytest.mark.parametrize("field", ["ranges_m", "bearings_rad", "covariances"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_feature_that_is_not_finite_is_left_out(field: str, value: float) -> None:
    seen = features()
    getattr(seen, field)[2] = value
    assert usable_rows(seen, 30.0, 0.0).numbers.tolist() == [0, 1, 3, 4, 5]


@pytest.mark.parametrize("covariance", [((-1.0, 0.0), (0.0, -1.0)), ((1.0, 2.0), (2.0, 1.0)), ((0.0, 0.0), (0.0, 1.0))])
def test_a_covariance_that_is_not_positive_definite_is_left_out(covariance: tuple[tuple[float, float], ...]) -> None:
    seen = features()
    seen.covariances[1] = covariance
    assert usable_rows(seen, 30.0, 0.0).numbers.tolist() == [0, 2, 3, 4, 5]


@pytest.mark.parametrize("range_m", [0.0, -1.0, 30.1])
def test_a_range_that_the_filter_does_not_use_is_left_out(range_m: float) -> None:
    seen = features()
    seen.ranges_m[0] = range_m
    assert usable_rows(seen, 30.0, 0.0).numbers.tolist() == [1, 2, 3, 4, 5]


def test_rows_are_ordered_nearest_first_and_point_from_the_body() -> None:
    seen = features()
    rows = usable_rows(seen, 30.0, 0.25)
    assert rows.order.tolist() == [5, 4, 3, 2, 1, 0]
    np.testing.assert_allclose(np.arctan2(rows.left, rows.ahead), seen.bearings_rad + 0.25)


def test_verdicts_of_the_usable_features_are_spread_over_all() -> None:
    seen = features()
    seen.ranges_m[:2] = math.nan
    verdicts = verdicts_of_all(usable_rows(seen, 30.0, 0.0), np.array((7, -1, 8, 9)), COUNT)
    assert verdicts.tolist() == [MatchVerdict.OUT_OF_RANGE, MatchVerdict.OUT_OF_RANGE, 7, MatchVerdict.NEW, 8, 9]


@pytest.mark.parametrize("way_m", [0.0, 0.01, LEAST_STEP_M, 0.25, LASTING_M, 7.0])
def test_looks_on_a_metre_of_way_add_up_to_one_look_of_what_lasts(way_m: float) -> None:
    """Of two features, one of a landmark that is well known and one of a landmark that may be half a metre off."""
    rows, matched = usable_rows(features(), 30.0, 0.0), np.array([0, 3])
    told = as_repeated(rows, matched, np.array([0.02, 0.5]) ** 2, way_m, (0.05, 0.01))
    more = LASTING_M / min(max(way_m, LEAST_STEP_M), LASTING_M) - 1.0
    weights = np.array([more, more * (0.05**2 + (7.0 * 0.01) ** 2) / 0.5**2])
    np.testing.assert_allclose((told.rr - rows.rr)[matched], weights * 0.05**2, atol=1e-15)
    np.testing.assert_allclose((told.bb - rows.bb)[matched], weights * 0.01**2, atol=1e-15)
    others = [1, 2, 4, 5]
    assert (told.rr[others] == rows.rr[others]).all()
    white = as_repeated(rows, matched, np.zeros(2), way_m, (0.0, 0.0))
    assert (white.rr == rows.rr).all()
