"""Whatever frames come: no thread ends, no total becomes nonsense, no memory grows. `make mutations` sends 100 000."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.drivers.waiting import wait_until
from tests.support.examples import examples
from tests.support.mutations.odd_bus import LAYOUTS, Running, check_frames, check_thread


@pytest.mark.parametrize("name", LAYOUTS)
@given(seed=st.integers(0, 2**32 - 1))
@examples(8)
def test_frames_with_any_content_leave_totals_that_are_numbers(name: str, seed: int) -> None:
    check_frames(name, seed)


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    reader = Running()
    wait_until(lambda: reader.encoders.health().counters.get("bus.sessions", 0) > 0)
    yield reader
    reader.close()


@given(seed=st.integers(0, 2**32 - 1))
@examples(25)
def test_the_thread_reads_on_whatever_the_bus_hands_it(running: Running, seed: int) -> None:
    check_thread(running, seed)
