import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wheels.history import WheelHistory


def history(*points: tuple[int, float, int], gap_ns: int = 100) -> WheelHistory:
    result = WheelHistory(gap_ns)
    for point in points:
        result.add(*point)
    return result


@given(
    speed=st.floats(-100, 100),
    steps=st.lists(st.integers(1, 100), min_size=2, max_size=40),
    part=st.floats(0, 1),
)
def test_a_steady_motion_is_read_exactly_at_any_instant(speed: float, steps: list[int], part: float) -> None:
    stamps = [sum(steps[:count]) for count in range(len(steps) + 1)]
    wheel = history(*((stamp, speed * stamp, 0) for stamp in stamps))
    instant = round(stamps[-3] + part * (stamps[-1] - stamps[-3]))
    found = wheel.at(instant)
    assert found is not None
    assert found[0] == pytest.approx(speed * instant, abs=1e-9 + 1e-9 * abs(speed * instant))


def test_nothing_is_known_outside_the_history() -> None:
    wheel = history((10, 1.0, 0), (20, 2.0, 0))
    assert wheel.at(9) is None
    assert wheel.at(21) is None
    assert wheel.at(10) == (1.0, 0)
    assert wheel.at(20) == (2.0, 0)
    assert history().at(0) is None


def test_epochs_are_not_joined_and_long_gaps_are_not_bridged() -> None:
    assert history((10, 1.0, 0), (20, 2.0, 1)).at(15) is None
    assert history((10, 1.0, 0), (210, 2.0, 0)).at(15) is None
    assert history((10, 1.0, 0), (210, 2.0, 0)).at(210) == (2.0, 0)


def test_points_of_one_instant_become_one() -> None:
    wheel = history((10, 1.0, 0), (20, 2.0, 0), (20, 3.0, 0), (19, 4.0, 0))
    assert wheel.newest_ns == 20
    assert wheel.at(20) == (4.0, 0)
    assert wheel.at(15) == (2.5, 0)
