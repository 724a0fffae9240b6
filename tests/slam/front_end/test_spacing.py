import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drivers.measurements import FloatArray
from slam.front_end.spacing import range_extrema, spaced

POINTS = arrays(np.float64, st.tuples(st.integers(0, 30), st.just(2)), elements=st.floats(-2.0, 2.0))


def distances(points: FloatArray) -> FloatArray:
    gaps: FloatArray = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    return gaps


@given(POINTS, st.floats(0.0, 1.0))
def test_accepted_features_keep_the_spacing_and_rejected_ones_have_an_accepted_neighbour(
    points: FloatArray, spacing: float
) -> None:
    kept = spaced(points, np.arange(len(points)), spacing)
    between = distances(points[kept]) + 10.0 * np.eye(int(kept.sum()))
    assert (between >= spacing - 1e-12).all()
    for rejected in points[~kept]:
        assert np.hypot(*(points[kept] - rejected).T).min() < spacing


def test_the_order_decides_which_of_two_neighbours_stays() -> None:
    points = np.array(((0.0, 0.0), (0.05, 0.0)))
    assert spaced(points, np.array((0, 1)), 0.1).tolist() == [True, False]
    assert spaced(points, np.array((1, 0)), 0.1).tolist() == [False, True]


def test_extrema_are_the_turning_points_of_range_over_usable_beams() -> None:
    ranges = np.array((5.0, 4.0, 5.0, 6.0, 0.0, 5.5, 5.5, 5.0, 7.0))
    usable = np.ones(9, dtype=np.bool_)
    usable[4] = False
    assert range_extrema(ranges, usable).tolist() == [1, 3, 7]


def test_fewer_than_three_usable_beams_have_no_extremum() -> None:
    assert range_extrema(np.array((1.0, 2.0)), np.ones(2, dtype=np.bool_)).size == 0
    assert range_extrema(np.array((1.0, 2.0, 1.0)), np.zeros(3, dtype=np.bool_)).size == 0
