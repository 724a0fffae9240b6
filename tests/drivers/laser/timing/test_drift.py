import numpy as np
import pytest

from drivers.laser.timing.drift import fastest_slope, slowest_slope, weigh

STEP_NS = 100_000_000


def points(rng: np.random.Generator, slope: float, jitter_ns: float, count: int = 300) -> list[tuple[int, int]]:
    """Delays along a line, each later by a uniform share of the jitter."""
    return [(k * STEP_NS, round(slope * k * STEP_NS + rng.uniform(0.0, jitter_ns))) for k in range(count)]


def test_the_slope_is_found_within_its_deviation() -> None:
    rng = np.random.default_rng(1)
    within = []
    for _ in range(60):
        slope, sigma, _ = fastest_slope(points(rng, 50e-6, 5e6), 0.0)
        within.append(abs(slope - 50e-6) < 2.0 * sigma)
    assert np.mean(within) > 0.9


def test_messages_that_are_late_for_a_third_of_the_time_move_the_slowest_and_not_the_fastest() -> None:
    rng = np.random.default_rng(2)
    delays = [
        (x, y + (30_000_000 if x > 200 * STEP_NS and x % (2 * STEP_NS) else 0)) for x, y in points(rng, 50e-6, 5e6)
    ]
    assert fastest_slope(delays, 0.0)[0] == pytest.approx(50e-6, abs=20e-6)
    assert abs(slowest_slope(delays, 0.0)[0] - 50e-6) > 1000e-6


def test_messages_without_jitter_leave_a_doubt() -> None:
    slope, sigma, _ = fastest_slope(points(np.random.default_rng(3), -20e-6, 0.0), 0.0)
    assert slope == pytest.approx(-20e-6, rel=1e-3)
    assert sigma > 1e-6


def test_of_two_estimates_the_surer_one_counts_more() -> None:
    value, sigma = weigh(0.0, 3.0, 1.0, 1.0)
    assert value == pytest.approx(0.9)
    assert sigma < 1.0
