"""Kinds of places, a laser that hangs upside down, and a rover that is carried away."""

import math
from typing import get_args

import numpy as np
import pytest

from drivers.settings.simulated_world import KidnapSettings, LaserGeometrySettings, Place, WorldSettings
from drivers.simulated.world.places.choose import world_of
from drivers.simulated.world.places.world import World

EXACT = LaserGeometrySettings(sigma_range_m=0.0, drop_out_share=0.0, mixed_share=0.0)
SEEN = {"park": 0.2, "building": 0.7, "corridor": 0.9, "orchard": 0.2, "empty": 0.0}
SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("place", get_args(Place))
def test_in_every_place_the_laser_sees_what_belongs_there_wherever_the_rover_is(place: Place) -> None:
    world = world_of(WorldSettings(place=place, people=0, laser=EXACT))
    for second in (0, 15, 40):
        ranges = world.ranges_at(second * SECOND_NS)
        assert np.isfinite(ranges).mean() >= SEEN[place]
        assert ranges.min() > 0.5
        if place == "empty":
            assert not np.isfinite(ranges).any()


@pytest.mark.parametrize("place", ["corridor", "orchard"])
def test_nothing_stands_in_the_way(place: Place) -> None:
    world = world_of(WorldSettings(place=place))
    assert isinstance(world, World)
    course = world.path.course
    assert world.clearance_m(course.points_m(np.arange(0.0, course.length_m, 0.2))) > 0.6


@pytest.mark.parametrize("place", ["park", "building"])
def test_a_laser_upside_down_sees_the_same_from_right_to_left(place: Place) -> None:
    hanging = EXACT.model_copy(update={"upside_down": True})
    up, down = (world_of(WorldSettings(place=place, people=0, bushes=0, laser=laser)) for laser in (EXACT, hanging))
    upright = up.ranges_at(0)
    if place == "building":  # glass lets beams through by chance
        assert np.isclose(down.ranges_at(0)[::-1], upright).mean() > 0.9
    else:
        assert down.ranges_at(0)[::-1] == pytest.approx(upright)
    assert not np.allclose(down.ranges_at(0), upright)


def test_a_rover_is_carried_away_at_its_times_and_its_wheels_do_not_notice() -> None:
    kidnaps = (KidnapSettings(start_s=5.0, x_m=3.0, y_m=0.0, turn_deg=90.0), KidnapSettings(start_s=8.0, turn_deg=0.0))
    plain, carried = world_of(WorldSettings()), world_of(WorldSettings(kidnaps=kidnaps))
    assert carried.map_from_body(4_999_999_999) == plain.map_from_body(4_999_999_999)
    before, after = plain.map_from_body(5 * SECOND_NS), carried.map_from_body(5 * SECOND_NS)
    assert np.subtract(after, before) == pytest.approx([3.0, 0.0, math.pi / 2.0])
    jump = np.subtract(carried.map_from_body(8 * SECOND_NS), carried.map_from_body(8 * SECOND_NS - 1000))
    assert jump == pytest.approx([2.0, 1.0, 0.0], abs=1e-5)
    assert carried.wheel_travel_m(9 * SECOND_NS) == plain.wheel_travel_m(9 * SECOND_NS)
