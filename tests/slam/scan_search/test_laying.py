"""A room is recognised by its walls, wherever the rover stands in it, and nothing else is taken for it."""

import math
import time

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.maps.views import BEAMS, NO_VIEWS, NOTHING_CM, Views, kept_points
from slam.pose import Pose2
from slam.scan_search.ground import CELL_M, Ground, Plan, ground_of
from slam.scan_search.laying import Laid, Laying
from slam.scan_search.stretch import LENGTH_M, Stretch
from tests.support.slam.corridor import BEARINGS_RAD, RANGE_MAX_M, ranges_of, ring_of_corridors

PLACES = (Pose2(8.0, 0.0, 0.3), Pose2(24.0, 6.0, 1.4), Pose2(15.0, 15.0, 3.0), Pose2(0.0, 12.0, -1.2))


def seen_from(pose: Pose2, lines: FloatArray) -> FloatArray:
    ranges = ranges_of(pose, lines)
    ranges = np.where(ranges < RANGE_MAX_M, ranges, np.nan)
    return np.column_stack((ranges * np.cos(BEARINGS_RAD), ranges * np.sin(BEARINGS_RAD)))


def around(pose: Pose2, lines: FloatArray) -> FloatArray:
    """What a rover sees that looks ahead and back."""
    behind = Pose2(0.0, 0.0, math.pi)
    both = np.vstack((seen_from(pose, lines), behind.transform(seen_from(pose @ behind, lines))))
    return both[np.isfinite(both).all(axis=1)]


def views_of(lines: FloatArray) -> Views:
    """Along the middle of the ring of corridors, both ways."""
    poses = [Pose2(x, y, heading) for x in np.arange(0.0, 24.1, 1.0) for y in (0.0, 15.0) for heading in (0.0, math.pi)]
    poses += [
        Pose2(x, y, h) for y in np.arange(1.0, 15.0, 1.0) for x in (0.0, 24.0) for h in (math.pi / 2, -math.pi / 2)
    ]
    points = np.stack([kept_points(seen_from(pose, lines)) for pose in poses])
    return Views(np.array([pose.as_array() for pose in poses]), points)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return ground_of(views_of(ring_of_corridors(1)))


def laid(ground: Ground, points: FloatArray, most_looks: int = 10**9) -> Laid:
    laying = Laying(ground, points)
    while (found := laying.advance(most_looks)) is None:
        pass
    return found


@pytest.mark.parametrize("place", PLACES)
def test_what_is_seen_around_a_place_lies_there_and_not_in_the_mirror(ground: Ground, place: Pose2) -> None:
    found = laid(ground, around(place, ring_of_corridors(1)))
    off = place.inverse() @ found.map_from_body
    assert math.hypot(off.x_m, off.y_m) < CELL_M
    assert abs(off.heading_rad) < 0.03
    assert found.odds > 0.0 > found.mirror_odds
    assert found.share > 0.8


@pytest.mark.parametrize("seed", range(4))
def test_other_corridors_of_the_same_width_are_not_taken_for_these(ground: Ground, seed: int) -> None:
    """One attempt may be misled a little; a place is believed at odds of 14."""
    assert laid(ground, around(PLACES[seed], ring_of_corridors(10 + seed))).odds < 4.0


def test_slices_of_work_change_no_bit(ground: Ground) -> None:
    points = around(PLACES[0], ring_of_corridors(1))
    whole, sliced = laid(ground, points), laid(ground, points, 5_000)
    assert (whole.map_from_body, whole.odds, whole.mirror_odds) == (
        sliced.map_from_body,
        sliced.odds,
        sliced.mirror_odds,
    )


def test_a_slice_is_not_much_more_work_than_was_asked_for(ground: Ground) -> None:
    """The places to refine are chosen in one slice: by a loop over all of them it took a hundred times as long.

    Every laying has the same slices, and whatever else the machine does falls on others each time.
    """
    points = around(PLACES[0], ring_of_corridors(1))
    spent_s = np.array([seconds_of_slices(ground, points) for _ in range(7)]).min(axis=0)
    assert 20 < len(spent_s) < 1_000
    assert max(spent_s) < 10.0 * np.median(spent_s)


def seconds_of_slices(ground: Ground, points: FloatArray) -> list[float]:
    laying, spent_s, found = Laying(ground, points), list[float](), None
    while found is None:
        begin_s = time.process_time()
        found = laying.advance(200_000)
        spent_s.append(time.process_time() - begin_s)
    return spent_s


def test_the_ground_is_finished_in_steps_that_change_no_bit(ground: Ground) -> None:
    plan = Plan(views_of(ring_of_corridors(1)))
    steps = 1
    while not plan.advance(20):
        steps += 1
    assert steps == -(-plan.added // 20) + 4, "the last views, and each grid made of them, by itself"
    assert plan.ground is not None
    assert np.array_equal(plan.ground.places, ground.places)
    assert np.array_equal(plan.ground.fine, ground.fine)
    assert np.array_equal(plan.ground.coarse, ground.coarse)


def test_only_places_near_a_point_are_tried_where_the_rover_may_be_near_it(ground: Ground) -> None:
    """And a stretch from there is found among them."""
    near = ground.near(PLACES[1].x_m, PLACES[1].y_m, 4.0)
    assert 0 < len(near.places) < 0.3 * len(ground.places)
    rows, columns = near.places.T
    x_m, y_m = ground.x_m + CELL_M * (columns + 0.5), ground.y_m + CELL_M * (rows + 0.5)
    assert np.hypot(x_m - PLACES[1].x_m, y_m - PLACES[1].y_m).max() <= 4.0
    off = PLACES[1].inverse() @ laid(near, around(PLACES[1], ring_of_corridors(1))).map_from_body
    assert math.hypot(off.x_m, off.y_m) < CELL_M
    assert len(ground.near(500.0, 500.0, 4.0).places) == 0


def test_a_map_without_views_has_no_place() -> None:
    assert len(ground_of(NO_VIEWS).places) == 0


def test_views_keep_returns_to_the_centimetre_and_turn_with_their_map() -> None:
    points = np.array(((1.234, -5.678), (np.nan, np.nan), (700.0, 2.0)))
    kept = kept_points(points)
    assert kept.shape == (BEAMS, 2)
    assert kept[0].tolist() == [123, -568]
    assert (kept[1] == NOTHING_CM).all()
    views = Views(np.array(((1.0, 2.0, 0.0),)), kept[None])
    assert views.points_m(0).tolist() == [[1.23, -5.68], [327.67, 2.0]]
    turned = views.joined(views).turned(Pose2(10.0, 0.0, math.pi / 2.0))
    assert turned.poses == pytest.approx(np.array(((8.0, 1.0, math.pi / 2.0),) * 2))


def test_a_stretch_ends_after_its_length_and_is_seen_from_where_the_rover_is() -> None:
    stretch = Stretch()
    due = [stretch.is_due]
    post = np.array(((5.0, 1.0),))
    stretch.add(np.zeros(3), post.astype(np.float32))
    due.append(stretch.is_due)
    assert due == [False, True], "the first scan is looked for by itself"
    assert stretch.take() == pytest.approx(post, abs=0.11)
    driven = 0.0
    while not stretch.is_due:
        driven += 0.5
        stretch.add(np.array((0.5, 0.0, 0.0)), (post - (driven, 0.0)).astype(np.float32))
    assert driven == LENGTH_M
    seen = stretch.take()
    assert np.abs(seen - (post - (driven, 0.0))).max() < 0.2, "all scans show the post at one place"
