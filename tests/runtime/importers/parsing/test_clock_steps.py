"""Stamps that do not rise: a clock that was set loses nothing, and what does not fit is as little as can be."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.importers.parsing.clock_steps import join_clock, longest_rising, step_sentences


@given(st.lists(st.sampled_from([0.0, 1.0, 2.0, 3.0, 5.0, float("nan"), float("inf")]), max_size=8))
def test_the_largest_rising_part_is_kept(stamps_s: list[float]) -> None:
    given_s = np.array(stamps_s)
    kept = given_s[longest_rising(given_s)]
    assert np.isfinite(kept).all()
    assert (np.diff(kept) > 0.0).all()
    finite = [stamp_s for stamp_s in stamps_s if np.isfinite(stamp_s)]
    rising = [
        len(part)
        for size in range(len(finite) + 1)
        for part in itertools.combinations(finite, size)
        if all(a < b for a, b in itertools.pairwise(part))
    ]
    assert len(kept) == max(rising, default=0)


def test_of_two_with_one_stamp_the_first_is_kept() -> None:
    assert longest_rising(np.array([1.0, 1.0, 2.0])).tolist() == [True, False, True]


@given(st.lists(st.integers(1, 9), min_size=4, max_size=40), st.data())
def test_every_step_of_the_clock_is_taken_out(intervals: list[int], data: st.DataObject) -> None:
    true_s = np.cumsum(intervals) * 0.05
    row = data.draw(st.integers(1, len(true_s) - 2))
    set_by_s = data.draw(st.sampled_from([-7200.0, -600.0, -40.0, 3e5]))
    read_s = true_s + np.where(np.arange(len(true_s)) >= row, set_by_s, 0.0)
    clock = join_clock(read_s.tolist())
    assert [step_row for step_row, _ in clock.steps] == [row]
    assert clock.good.all()
    np.testing.assert_allclose(
        np.diff(clock.stamps_s)[np.arange(1, len(true_s)) != row], np.diff(true_s)[np.arange(1, len(true_s)) != row]
    )
    assert 0.0 < clock.stamps_s[row] - clock.stamps_s[row - 1] < 1.0


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False, width=32), max_size=20))
def test_any_stamps_are_taken(stamps_s: list[float]) -> None:
    clock = join_clock(stamps_s)
    assert np.isfinite(clock.stamps_s).all()


def test_lines_out_of_order_by_a_little_are_no_step() -> None:
    clock = join_clock([1.0, 1.2, 1.1, 1.4])
    assert (clock.steps, clock.stamps_s.tolist()) == ([], [1.0, 1.2, 1.1, 1.4])


def test_a_clock_that_jumps_for_ever_is_told_in_a_few_sentences() -> None:
    steps = [(row, -5.0) for row in range(100_000)]
    told = step_sentences(steps, lambda row: f"x.log:{row}: the clock")
    assert len(told) == 11
    assert told[0].startswith("x.log:0: the clock was set back by 5.0 s")
    assert told[-1].startswith("and 99990 more times")
