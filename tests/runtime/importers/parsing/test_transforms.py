"""Fixed transforms are put together along whatever chain there is."""

import math

import numpy as np
import pytest

from runtime.importers.parsing.transforms import between, matrix

LEFT = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))  # a quarter turn


def test_a_chain_is_followed_in_both_directions() -> None:
    transforms = {
        ("footprint", "base"): matrix((0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)),
        ("base", "mast"): matrix((1.0, 0.0, 0.0), LEFT),
        ("mast", "laser"): matrix((2.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0)),
        ("base", "camera"): matrix((5.0, 5.0, 5.0), LEFT),
    }
    footprint_from_laser = between(transforms, "footprint", "laser")
    assert footprint_from_laser is not None
    np.testing.assert_allclose(footprint_from_laser[:3, 3], (1.0, 2.0, 0.1), atol=1e-12)
    laser_from_footprint = between(transforms, "laser", "footprint")
    assert laser_from_footprint is not None
    np.testing.assert_allclose(laser_from_footprint @ footprint_from_laser, np.eye(4), atol=1e-12)


def test_frames_that_do_not_hang_together_have_none() -> None:
    assert between({("a", "b"): np.eye(4)}, "a", "laser") is None
    assert between({}, "a", "b") is None


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 0.0), (1e300, 0.0, 0.0, 1e300)])
def test_a_quaternion_that_is_none_does_no_harm(turn: tuple[float, float, float, float]) -> None:
    assert np.isfinite(matrix((0.0, 0.0, 0.0), turn)).all()
