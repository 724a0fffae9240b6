import numpy as np

from drivers.measurements import BoolArray, FloatArray
from slam.front_end.stillness import STILL_NS, Stillness

TICK_NS = 100_000_000
TICKS = STILL_NS // TICK_NS
ALL = np.array(((0, 9),))


def after(ranges_m: list[FloatArray], stands: list[bool] | None = None) -> tuple[BoolArray, Stillness]:
    """(10,) beams after some scans, each asked for by itself."""
    stillness = Stillness()
    for number, ranges in enumerate(ranges_m):
        stillness.follow(ranges, number * TICK_NS, stands=stands is None or stands[number])
    each = np.column_stack((np.arange(10), np.arange(10)))
    return stillness.licences(ranges_m[-1], (len(ranges_m) - 1) * TICK_NS, each), stillness


def wall(scans: int) -> list[FloatArray]:
    noise = np.random.default_rng(1)
    return [4.0 + noise.normal(0.0, 0.02, 10) for _ in range(scans)]


def test_what_has_stood_for_twenty_seconds_is_still_and_not_before() -> None:
    assert not after(wall(TICKS))[0].any()
    assert after(wall(TICKS + 1))[0].all()


def test_whoever_passes_or_stands_for_a_while_is_not_and_what_he_hid_has_to_stand_again() -> None:
    scans = wall(2 * TICKS)
    for number in range(TICKS, TICKS + 150):
        scans[number][3:6] = 2.5
    still, _ = after(scans[: TICKS + 140])
    assert still.tolist() == [True] * 3 + [False] * 3 + [True] * 4
    assert after(scans)[0].tolist() == [True] * 3 + [False] * 3 + [True] * 4


def test_a_beam_that_seldom_returns_is_not_still() -> None:
    scans = wall(3 * TICKS)
    for number, ranges in enumerate(scans):
        ranges[2] = ranges[2] if number % 3 == 2 else np.nan
        ranges[5] = ranges[5] if number % 3 else np.nan
    still, _ = after(scans)
    assert not still[2]
    assert still[5] == (not np.isnan(scans[-1][5]))


def test_two_thirds_of_a_feature_are_enough_and_a_move_begins_anew() -> None:
    scans = wall(TICKS + 1)
    scans[-1][:3] = 2.0
    still, stillness = after(scans)
    assert stillness.licences(scans[-1], TICKS * TICK_NS, ALL).all()
    scans[-1][:4] = 2.0
    assert not after(scans)[1].licences(scans[-1], TICKS * TICK_NS, ALL).any()
    moved = [True] * (TICKS + 1)
    moved[5] = False
    assert not after(wall(TICKS + 1), moved)[0].any()
    assert not still.all()
