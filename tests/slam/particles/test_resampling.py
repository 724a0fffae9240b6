"""Systematic resampling on log weights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.particles.resampling import effective_particles, normalised, parents_in_place, systematic_copies

SEEDS = st.integers(0, 2**32 - 1)
COUNTS = st.integers(1, 137)


@given(SEEDS, COUNTS, st.floats(0.0, 1.0, exclude_max=True))
def test_every_particle_is_kept_as_often_as_its_weight_demands_within_one(seed: int, count: int, offset: float) -> None:
    weights = np.random.default_rng(seed).dirichlet(np.full(count, 0.3))
    copies = systematic_copies(weights, offset)
    assert copies.sum() == count
    assert (copies >= np.floor(weights * count - 1e-9)).all()
    assert (copies <= np.ceil(weights * count + 1e-9)).all()


@pytest.mark.parametrize("count", [3, 7, 13, 100, 997])
def test_a_count_that_does_not_divide_evenly_is_kept(count: int) -> None:
    assert np.array_equal(systematic_copies(np.full(count, 1.0 / count), 0.37), np.ones(count))


def test_copies_are_unbiased() -> None:
    generator = np.random.default_rng(3)
    weights = np.array((0.5, 0.3, 0.15, 0.05))
    mean = np.mean([systematic_copies(weights, offset) for offset in generator.random(4000)], axis=0)
    np.testing.assert_allclose(mean, weights * 4, atol=0.05)


@given(SEEDS, COUNTS)
def test_survivors_stay_in_their_place_and_the_dead_take_their_surplus(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    copies = systematic_copies(generator.dirichlet(np.full(count, 0.2)), float(generator.random()))
    parents = parents_in_place(copies)
    assert np.array_equal(np.bincount(parents, minlength=count), copies)
    alive = copies > 0
    assert np.array_equal(parents[alive], np.flatnonzero(alive))


def test_log_weights_far_below_underflow_still_sum_to_one() -> None:
    weights = normalised(np.array((-5000.0, -5001.0, -9000.0)))
    assert weights.sum() == pytest.approx(1.0)
    assert weights[0] / weights[1] == pytest.approx(np.e)


def test_weights_without_one_finite_number_become_equal() -> None:
    np.testing.assert_allclose(normalised(np.array((np.nan, -np.inf))), 0.5)
    np.testing.assert_allclose(normalised(np.array((np.nan, -3.0))), (0.0, 1.0))


def test_effective_particles_run_from_one_to_all() -> None:
    assert effective_particles(np.full(40, 1 / 40)) == pytest.approx(40.0)
    assert effective_particles(np.eye(40)[3]) == pytest.approx(1.0)
