"""Whole arrays get what single numbers get, and normal numbers are normal."""

import numpy as np

from slam.arithmetic import elementary
from slam.arithmetic.functions import arctangents, composed, cosines_sines, exponentials, lengths, normals
from slam.pose import Pose2
from slam.pose import composed as composed_by_numpy

ANGLES = np.random.default_rng(2).uniform(-20.0, 20.0, (30, 4))


def test_arrays_of_any_shape_get_what_single_numbers_get() -> None:
    cosines, sines = cosines_sines(ANGLES.T)
    assert cosines.shape == sines.shape == (4, 30)
    pairs = [elementary.cosine_sine(angle) for angle in ANGLES.T.ravel().tolist()]
    np.testing.assert_array_equal(np.column_stack((cosines.ravel(), sines.ravel())), pairs)
    y, x = ANGLES[:, 0], ANGLES[:, 1]
    directions = [elementary.arctangent(*pair) for pair in zip(y.tolist(), x.tolist(), strict=True)]
    np.testing.assert_array_equal(arctangents(y, x), directions)
    np.testing.assert_array_equal(exponentials(x), [elementary.exponential(value) for value in x.tolist()])
    single = cosines_sines(np.array(1.25))
    assert (float(single[0]), float(single[1])) == elementary.cosine_sine(1.25)


def test_lengths_are_those_of_the_vectors() -> None:
    np.testing.assert_allclose(
        lengths(ANGLES.reshape(5, 12, 2)), np.hypot(*np.moveaxis(ANGLES.reshape(5, 12, 2), -1, 0))
    )


def test_rows_of_poses_are_composed_as_single_ones() -> None:
    outer, inner = ANGLES[:, :3], ANGLES[:, 1:]
    np.testing.assert_allclose(composed(outer, inner), composed_by_numpy(outer, inner), atol=1e-12)
    np.testing.assert_allclose(composed(outer[0], inner), composed_by_numpy(outer[0], inner), atol=1e-12)
    one = (Pose2(*outer[0].tolist()) @ Pose2(*inner[0].tolist())).as_array()
    np.testing.assert_array_equal(composed(outer, inner)[0, :2], one[:2])


def test_normal_numbers_are_normal_and_independent() -> None:
    drawn = normals(np.random.default_rng(3), 50_001)
    assert drawn.shape == (50_001, 3)
    np.testing.assert_allclose(np.cov(drawn.T), np.eye(3), atol=0.02)
    np.testing.assert_allclose((drawn.mean(), (drawn**3).mean(), (drawn**4).mean()), (0.0, 0.0, 3.0), atol=0.05)
    for sigmas, share in ((1.0, 0.3173), (2.0, 0.0455), (3.0, 0.0027)):
        assert abs((np.abs(drawn) > sigmas).mean() - share) < 0.05 * share + 2e-4
    np.testing.assert_allclose(np.corrcoef(drawn.ravel()[:-1], drawn.ravel()[1:])[0, 1], 0.0, atol=0.01)
