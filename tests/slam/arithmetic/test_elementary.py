"""The own elementary functions are those of the C library to two units in the last place, compiled or not."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from slam.arithmetic import elementary, functions

GENERATOR = np.random.default_rng(1)
WIDE = (GENERATOR.standard_normal(4000) * 10.0 ** GENERATOR.uniform(-7.0, 4.5, 4000)).tolist()
NARROW = GENERATOR.uniform(-700.0, 700.0, 4000).tolist()
ODD = (0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, 1e308, -1e308, 1e5, 0.5 * math.pi, -math.pi)

Function = Callable[..., float | tuple[float, float]]


def ulps(found: float, right: float) -> float:
    return abs(found - right) / math.ulp(right)


def test_cosine_and_sine_are_those_of_the_library() -> None:
    for angle in WIDE:
        cosine, sine = elementary.cosine_sine(angle)
        assert ulps(cosine, math.cos(angle)) <= 1.0, angle
        assert ulps(sine, math.sin(angle)) <= 1.0, angle


def test_angles_of_many_turns_are_turned_back_and_those_that_are_none_stay_none() -> None:
    np.testing.assert_allclose(elementary.cosine_sine(3e7 + 1.0), (math.cos(3e7 + 1.0), math.sin(3e7 + 1.0)), atol=1e-8)
    for angle in (math.inf, -math.inf, math.nan):
        assert all(map(math.isnan, elementary.cosine_sine(angle)))


def test_the_arctangent_is_that_of_the_library_with_its_signs() -> None:
    for y, x in zip(WIDE, reversed(WIDE), strict=True):
        assert ulps(elementary.arctangent(y, x), math.atan2(y, x)) <= 2.0, (y, x)
    for y in ODD:
        for x in ODD:
            found, right = elementary.arctangent(y, x), math.atan2(y, x)
            assert math.isnan(found) == math.isnan(right), (y, x)
            assert math.isnan(right) or (ulps(found, right) <= 1.0 and math.copysign(1.0, found * right) == 1.0), (y, x)


def test_exponential_and_logarithm_are_those_of_the_library() -> None:
    for value in NARROW:
        assert ulps(elementary.exponential(value), math.exp(value)) <= 1.0, value
        assert ulps(elementary.logarithm(math.exp(value)), math.log(math.exp(value))) <= 1.0, value
    for value in np.linspace(0.5, 2.0, 2000).tolist():
        assert ulps(elementary.logarithm(value), math.log(value)) <= 1.0, value
    assert [elementary.exponential(value) for value in (-math.inf, -800.0, 800.0, math.inf)] == [
        0,
        0,
        math.inf,
        math.inf,
    ]
    assert (elementary.logarithm(0.0), elementary.logarithm(math.inf)) == (-math.inf, math.inf)
    assert all(
        map(math.isnan, (elementary.logarithm(-1.0), elementary.logarithm(math.nan), elementary.exponential(math.nan)))
    )


@pytest.mark.parametrize("name", ["cosine_sine", "arctangent", "exponential", "logarithm", "hypotenuse"])
def test_compiled_they_give_the_same_bits(name: str) -> None:
    plain: Function = getattr(elementary, name)
    compiled: Function = getattr(functions, name)
    two = name in ("arctangent", "hypotenuse")
    for value, other in zip((*WIDE, *NARROW, *ODD), (*NARROW, *WIDE, *reversed(ODD)), strict=True):
        arguments = (value, other) if two else (value,)
        assert repr(compiled(*arguments)) == repr(plain(*arguments)), arguments
