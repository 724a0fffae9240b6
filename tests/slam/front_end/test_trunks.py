import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.measurements import Scan, uniform_bearings
from slam.front_end.deskew import Beams, Twist, deskew
from slam.front_end.trunks import holes_in, runs_of_beams, trunk_variances, trunks
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from tests.support.examples import examples

SPACING = math.radians(0.25)
BEARINGS = uniform_bearings(-math.pi / 2, SPACING, 721)
SETTINGS = FrontEndSettings()


def beams_of(ranges: NDArray[np.float64]) -> Beams:
    scan = Scan(0, ranges.astype(np.float32), BEARINGS, range_max_m=60.0)
    return deskew(scan, Twist(), Pose2(), 0.1, 60.0)


def round_trunk(distance: float, bearing: float, radius: float) -> NDArray[np.float64]:
    across = distance * np.sin(BEARINGS - bearing)
    face = distance * np.cos(BEARINGS - bearing) - np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    return np.where((np.abs(across) < radius) & (np.cos(BEARINGS - bearing) > 0.0), face, np.inf)


def found(ranges: NDArray[np.float64], settings: FrontEndSettings = SETTINGS) -> NDArray[np.float64]:
    beams = beams_of(ranges)
    holes = holes_in(beams)
    return trunks(beams, runs_of_beams(beams, holes), settings, holes)


@examples(200)
@given(st.floats(1.0, 25.0), st.floats(-1.1, 1.1), st.floats(0.03, 0.35))
@example(24.0, 0.40625, 0.203125)  # four returns, of which one grazes the edge
def test_the_centre_of_a_round_trunk_is_within_four_sigma_of_what_is_claimed(
    distance: float, bearing: float, radius: float
) -> None:
    trunk = round_trunk(distance, bearing, radius)
    if np.isinf(trunk).all() or distance < 3.0 * radius:
        return
    if 2.0 * radius + 2.0 * SPACING * distance > SETTINGS.width_max_m:
        return  # with half a beam beside either edge it can be too wide to be taken for a trunk
    one = found(trunk)
    assert one.shape == (1, 6)
    variances = trunk_variances(one, SPACING, SETTINGS)[0]
    assert abs(one[0, 0] - distance) < 4.0 * math.sqrt(variances[0])
    assert abs(one[0, 1] - bearing) < 4.0 * math.sqrt(variances[1])


def test_a_wall_with_holes_has_no_trunks_and_a_post_before_the_sky_is_still_one() -> None:
    rng = np.random.default_rng(2)
    wall = np.where(np.abs(BEARINGS) < 1.0, 6.0 / np.cos(BEARINGS), np.inf)
    for share in (0.05, 0.2, 0.5):
        assert len(found(np.where(rng.random(len(wall)) < share, np.inf, wall))) == 0
    post = round_trunk(8.0, 0.0, 0.2)
    assert len(found(post)) == 1
    assert len(found(np.minimum(post, round_trunk(7.0, 0.12, 0.2)))) == 2


def test_the_holes_that_chance_makes_are_taken_for_holes() -> None:
    rng = np.random.default_rng(3)
    wall = np.where(np.abs(BEARINGS) < 1.3, 6.0 / np.cos(BEARINGS), np.inf)
    bridges = [
        holes_in(beams_of(np.where(rng.random(len(wall)) < share, np.inf, wall))).bridge for share in (0, 0.2, 0.5)
    ]
    assert bridges[0] == 1
    assert 3 <= bridges[1] <= 5
    assert 8 <= bridges[2] <= 12


def test_something_nearer_beside_a_trunk_hides_its_edge_and_rejects_it() -> None:
    trunk = round_trunk(8.0, 0.0, 0.2)
    hit = np.flatnonzero(np.isfinite(trunk))
    for beside in (hit[0] - 1, hit[-1] + 1, hit[0] - 2):
        hidden = trunk.copy()
        hidden[beside] = 5.0
        centres = found(hidden)
        assert not np.any(np.abs(centres[:, 0] - 8.0) < 0.5), beside


def test_background_right_behind_a_trunk_rejects_it_and_background_far_behind_does_not() -> None:
    trunk = round_trunk(8.0, 0.0, 0.2)
    assert len(found(np.minimum(trunk, 8.2))) == 0
    assert len(found(np.minimum(trunk, 12.0))) == 1


def test_a_thin_post_needs_more_prominence_than_a_trunk() -> None:
    post = round_trunk(14.0, 0.0, 0.04)
    assert np.isfinite(post).sum() <= 2
    assert len(found(np.minimum(post, 14.4))) == 0
    assert len(found(np.minimum(post, 15.0))) == 1


def test_a_trunk_at_the_end_of_the_sweep_is_not_used() -> None:
    assert len(found(round_trunk(8.0, math.pi / 2, 0.2))) == 0


def test_a_flat_board_is_no_trunk() -> None:
    board = np.where(np.abs(5.0 * np.tan(BEARINGS)) < 0.35, 5.0 / np.cos(BEARINGS), np.inf)
    assert len(found(board)) == 0


@pytest.mark.parametrize(("width", "at_most"), [(4, 0.5), (6, 0.17), (8, 0.04), (12, 0.005)])
def test_a_bush_is_told_from_a_trunk_the_better_the_more_beams_fall_on_it(width: int, at_most: float) -> None:
    """Leaves anywhere within its front half. Taken were 47.6, 15.4, 3.4 and 0 % of those with so many beams."""
    generator, distance, taken = np.random.default_rng(1), 20.0, 0
    radius = 0.5 * width * SPACING * distance
    for _ in range(1000):
        bush = np.full(721, np.inf)
        bush[350 : 350 + width] = distance - radius * generator.uniform(0.0, 1.0, width)
        taken += bool((found(bush)[:, 3] == width).any())
    assert taken / 1000 <= at_most


def test_one_empty_beam_does_not_cut_a_trunk_in_two() -> None:
    trunk = round_trunk(8.0, 0.0, 0.3)
    trunk[360] = np.inf
    assert len(found(trunk)) == 1


def test_one_beam_half_beside_the_edge_moves_the_centre_by_less_than_a_beam() -> None:
    trunk = round_trunk(8.0, 0.0, 0.3)
    before = found(np.minimum(trunk, 20.0))[0]
    edge = np.flatnonzero(np.isfinite(trunk))[0] - 1
    mixed = np.minimum(trunk, 20.0)
    mixed[edge] = 8.2
    after = found(mixed)
    assert len(after) == 1
    assert abs(after[0, 1] - before[1]) < SPACING
    assert abs(after[0, 0] - before[0]) < 0.03


def test_a_wall_is_one_run_and_no_trunk() -> None:
    beams = beams_of(4.0 / np.maximum(np.cos(BEARINGS), 1e-3))
    holes = holes_in(beams)
    runs = runs_of_beams(beams, holes)
    longest = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    seen = np.degrees(BEARINGS[longest])
    assert seen[0] < -65.0
    assert seen[1] > 65.0
    assert len(trunks(beams, runs, SETTINGS, holes)) == 0


@pytest.mark.parametrize("value", [np.nan, 5.0, 0.0])
def test_nothing_at_all_and_one_range_everywhere_hold_no_trunk(value: float) -> None:
    assert len(found(np.full(721, value))) == 0
