import numpy as np

from drivers.measurements import FloatArray
from runtime.calibrate.single_causes import FALSE_ALARM, Fit, single_causes

NAMES = ("a", "b", "c", "d")
# a and b are hard to tell apart, as the radii of two wheels are from the mount and the latency
SPREAD: FloatArray = np.array(((1.0, 0.8, 0.2, 0.0), (0.8, 1.0, 0.0, 0.1), (0.2, 0.0, 1.0, 0.0), (0.0, 0.1, 0.0, 1.0)))


def _fit(values: FloatArray, covariance: FloatArray = SPREAD) -> Fit:
    return Fit(NAMES, np.zeros(4), values, covariance, 500)


def _directions(fit: Fit) -> dict[str, FloatArray]:
    return {name: fit.direction({name: 1.0}) for name in NAMES} | {"ab": fit.direction({"a": 1.0, "b": 1.0})}


def _drawn(truth: FloatArray, rng: np.random.Generator) -> Fit:
    return _fit(truth + rng.multivariate_normal(np.zeros(4), SPREAD))


def test_a_single_cause_is_told_where_the_free_estimate_leaves_it_open() -> None:
    """Of 400 draws whose free estimate of a has 3.2 deviations of bias, less than half pass 3.5; alone, nearly all."""
    rng = np.random.default_rng(3)
    free = told = 0
    for _ in range(400):
        fit = _drawn(np.array((3.2, 0.0, 0.0, 0.0)), rng)
        free += abs(fit.values[0]) > fit.sure
        told += [cause.name for cause in single_causes(fit, _directions(fit))] == ["a"]
    assert free < 200
    assert told > 340


def test_nothing_is_told_of_what_does_not_deviate() -> None:
    rng = np.random.default_rng(4)
    drawn = [_drawn(np.zeros(4), rng) for _ in range(4000)]
    alarms = sum(bool(single_causes(fit, _directions(fit))) for fit in drawn)
    assert alarms <= 4000 * 5 * FALSE_ALARM * 2.5  # five causes; a chance of 1 in 1000 to be above it


def test_two_causes_are_told_with_their_sizes() -> None:
    fit = _fit(np.array((9.0, 9.0, 0.0, -7.0)), 0.2 * SPREAD)
    found = {cause.name: cause.value for cause in single_causes(fit, _directions(fit))}
    assert set(found) == {"ab", "d"}
    assert abs(found["ab"] - 9.0) < 1.0
    assert abs(found["d"] + 7.0) < 1.0


def test_what_explains_as_well_is_named_beside_it() -> None:
    """a minus b is known, their sum is not: either may be the cause."""
    covariance = np.eye(4)
    covariance[:2, :2] = np.array(((50.0, 49.9), (49.9, 50.0)))
    fit = _fit(np.array((1.5, -1.5, 0.0, 0.0)), covariance)
    (cause,) = single_causes(fit, _directions(fit))
    assert {cause.name, *cause.rivals} == {"a", "b"}


def test_fewer_steps_ask_for_more() -> None:
    few, many = (Fit(NAMES, np.zeros(4), np.zeros(4), SPREAD, steps) for steps in (15, 5000))
    assert 3.4 < many.sure < 3.6 < few.sure


def test_the_least_that_is_told_is_told_in_half_of_the_cases() -> None:
    rng = np.random.default_rng(5)
    direction = _fit(np.zeros(4)).direction({"a": 1.0})
    truth = direction * _fit(np.zeros(4)).detectable(direction)
    told = sum(bool(single_causes(_drawn(truth, rng), {"a": direction})) for _ in range(400))
    assert 150 < told < 250
