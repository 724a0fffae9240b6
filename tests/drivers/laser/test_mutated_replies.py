"""Whatever a laser answers: the driver is in no other state than before. `make mutations` makes 20 000 replies."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.examples import examples
from tests.support.mutations.odd_laser import OddLaser, check_session


@pytest.fixture(scope="module", autouse=True)
def _counted() -> Iterator[None]:
    OddLaser.replies = OddLaser.scans = 0
    yield
    assert OddLaser.replies > 500
    assert OddLaser.scans > 0


@given(seed=st.integers(0, 2**32 - 1))
@examples(30)
def test_no_reply_raises_what_the_driver_does_not_know(seed: int) -> None:
    check_session(seed)
