import math

import numpy as np
import pytest

from runtime.studies.recognition.constellations import (
    SCALE,
    VIEW_M,
    local_points,
    mapped,
    scattered,
    seen_from,
    somewhere,
)
from runtime.studies.recognition.trials import recognition_trial
from slam.pose import Pose2
from slam.recognise.attempt import Attempt, Hypothesis, odds_of, recognise
from slam.recognise.map_index import index_of
from slam.recognise.prior import PosePrior

PLACES = 12


def apart(pose: Pose2, other: Pose2) -> tuple[float, float]:
    off = pose.inverse() @ other
    return math.hypot(off.x_m, off.y_m), abs(off.heading_rad)


@pytest.mark.parametrize("count", [80, 400])
def test_the_pose_is_found_among_clutter_and_the_mirror_is_not(count: int) -> None:
    generator = np.random.default_rng(count)
    things = scattered(generator, count)
    index = mapped(generator, things)
    for _ in range(PLACES):
        pose = somewhere(generator, things)
        found = recognise(index, seen_from(generator, pose, things))
        distance_m, turn_rad = apart(pose, found.map_from_body)
        assert found.acceptable
        assert found.probability_wrong == 1e-3
        assert found.mirror_odds < 7.0
        assert distance_m < 0.3
        assert turn_rad < 0.03


def test_another_world_is_refused() -> None:
    generator = np.random.default_rng(1)
    index = mapped(generator, scattered(generator, 200))
    other = scattered(generator, 200)
    for _ in range(PLACES):
        found = recognise(index, seen_from(generator, somewhere(generator, other), other))
        assert not found.acceptable
        assert found.odds < 7.0


def test_a_grid_of_trees_looks_the_same_everywhere_and_is_refused() -> None:
    generator = np.random.default_rng(2)
    trees = 5.0 * np.stack(np.meshgrid(np.arange(14), np.arange(14)), axis=-1).reshape(-1, 2)
    trees = trees + 0.02 * generator.standard_normal(trees.shape)
    index = index_of(SCALE, np.arange(len(trees)), trees)
    for _ in range(2):
        found = recognise(index, seen_from(generator, somewhere(generator, trees), trees, clutter=0))
        assert found.odds < 3.0
        assert not found.acceptable


def test_what_stands_unmatched_counts_against_a_place() -> None:
    """A pose that throws most of what is seen off the map may not win on the agreeing rest."""
    generator = np.random.default_rng(3)
    things = scattered(generator, 100)
    index, pose = mapped(generator, things), somewhere(generator, things)
    seen = seen_from(generator, pose, things, clutter=0).points_m[:12]
    beside = generator.uniform(-VIEW_M, VIEW_M, (30, 2))
    alone, crowded = recognise(index, local_points(seen)), recognise(index, local_points(np.vstack((seen, beside))))
    assert alone.acceptable
    assert crowded.odds < alone.odds - 10.0
    assert not crowded.acceptable


def test_slices_are_bounded_and_come_to_the_same_result_as_one_go() -> None:
    generator = np.random.default_rng(4)
    things = scattered(generator, 300)
    index = mapped(generator, things)
    points = seen_from(generator, somewhere(generator, things), things)
    whole = recognise(index, points)
    attempt, slices, states = Attempt(SCALE, index.indexed, points), 0, set()
    while (found := attempt.advance(1000)) is None:
        slices += 1
        states.add(attempt.state)
    assert slices > 10
    assert len(states) == slices
    assert (found.map_from_body, found.odds, found.mirror_odds) == (whole.map_from_body, whole.odds, whole.mirror_odds)
    assert found.known.tolist() == whole.known.tolist()


def test_an_attempt_is_not_disturbed_by_the_map_that_grows_meanwhile() -> None:
    generator = np.random.default_rng(5)
    things = scattered(generator, 200)
    index, pose = mapped(generator, things), somewhere(generator, things)
    points = seen_from(generator, pose, things)
    whole, attempt = recognise(index, points), Attempt(SCALE, index.indexed, points)
    attempt.advance(2000)
    index.follow(np.arange(5000, 5400), scattered(generator, 400))
    while (found := attempt.advance(2000)) is None:
        pass
    assert found.odds == whole.odds


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points_are_no_place(count: int) -> None:
    generator = np.random.default_rng(6)
    found = recognise(mapped(generator, scattered(generator, 50)), local_points(np.zeros((count, 2))))
    assert not found.acceptable
    assert found.probability_wrong == 1.0


def test_an_empty_map_and_points_in_one_place_are_no_place() -> None:
    empty = index_of(SCALE, np.empty(0, dtype=np.int64), np.empty((0, 2)))
    assert not recognise(empty, local_points(np.random.default_rng(7).uniform(-9.0, 9.0, (9, 2)))).acceptable
    one = index_of(SCALE, np.arange(9), np.ones((9, 2)))
    assert not recognise(one, local_points(np.ones((9, 2)))).acceptable


def test_the_stated_probability_is_never_below_what_trials_can_show() -> None:
    known = np.arange(8)
    stated = [Hypothesis(Pose2(), odds, -9.0, known, known, 8).probability_wrong for odds in (-1.0, 0.5, 5.0, 40.0)]
    assert stated == [1.0, 10.0 * math.exp(-0.5), 10.0 * math.exp(-5.0), 1e-3]


def test_the_nearest_points_keep_their_own_covariance() -> None:
    points = local_points(np.array(((9.0, 0.0), (1.0, 1.0), (0.0, 4.0))))
    points.covariance_m2[2:4, 4:6] = 0.5 * np.eye(2)
    near = points.nearest(2)
    assert near.identities.tolist() == [1, 2]
    assert near.points_m.tolist() == [[1.0, 1.0], [0.0, 4.0]]
    assert (near.covariance_m2[:2, 2:] == 0.5 * np.eye(2)).all()
    assert len(points.nearest(7)) == 3


def test_odds_are_counted_in_units_of_what_chance_reaches_here() -> None:
    """Where things stand in rows, the best of many wrong places is far above the second."""
    alone = odds_of([40.0, -3.0], [-3.0, -5.0, -6.0])
    assert alone == pytest.approx(40.0 - math.log(1.0 + math.exp(-3.0)))
    rivals = [20.0, 15.0, 11.0, 8.0, 6.0]
    assert odds_of([40.0, *rivals], rivals) == pytest.approx((40.0 - 20.0) / 7.5, abs=0.01)
    assert odds_of([40.0, *rivals[:2]], rivals[:2]) == pytest.approx(20.0, abs=0.01)
    assert odds_of([], []) == -math.inf


def test_only_the_place_that_was_named_counts_where_two_look_alike() -> None:
    """Two equal groves 200 m apart: nothing tells them apart but what was said."""
    generator = np.random.default_rng(8)
    grove = 0.35 * scattered(generator, 120)
    shift = Pose2(200.0, 30.0, 0.0)
    means = np.vstack((grove, shift.transform(grove)))
    index = index_of(SCALE, np.arange(len(means)), means)
    pose = somewhere(generator, grove)
    points = seen_from(generator, pose, grove)
    assert recognise(index, points).odds < 1.0
    for place in (pose, shift @ pose):
        found = recognise(index, points, PosePrior(place @ Pose2(1.0, -0.5, 0.2), 1.0, 0.3))
        assert found.acceptable
        assert found.odds > 20.0
        distance_m, turn_rad = apart(place, found.map_from_body)
        assert distance_m < 0.3
        assert turn_rad < 0.03


@pytest.mark.parametrize("count", [80, 400])
def test_where_nothing_of_what_is_said_is_true_nothing_is_believed(count: int) -> None:
    """Said somewhere else in the map, in another world, in the mirror: the odds are those of chance."""
    generator = np.random.default_rng(count)
    things = scattered(generator, count)
    index = mapped(generator, things)
    for _ in range(3 * PLACES):
        points = seen_from(generator, somewhere(generator, things), things)
        found = recognise(index, points, PosePrior(somewhere(generator, things), 0.5, 0.26))
        assert not found.acceptable
        assert found.odds < 10.0
        assert found.mirror_odds < 10.0


def test_a_map_that_is_as_exact_as_its_landmarks_says_more_than_one_that_is_bent() -> None:
    generator = np.random.default_rng(11)
    things = scattered(generator, 100)
    seen = things[np.argsort(np.hypot(*(things - things.mean(axis=0)).T))[:7]]
    x_m, y_m = seen.mean(axis=0).tolist()
    pose = Pose2(x_m, y_m, 0.0)
    points = local_points(pose.inverse().transform(seen))
    bent = things + 0.5 * SCALE.sigma_m * generator.standard_normal(things.shape)
    exact_odds, bent_odds = (recognise(index_of(SCALE, np.arange(100), map_m), points).odds for map_m in (things, bent))
    assert exact_odds > 25.0, "it was 22.6 where every map was taken for bent"
    assert bent_odds < exact_odds - 2.0


def test_where_things_stand_in_rows_the_mirror_is_measured_by_rivals_however_far_below() -> None:
    """An orchard in which one mirrored place is far above all others, and those are far above chance elsewhere."""
    trial = recognition_trial("orchard, 0.3 m", 6, 196, 20, "")
    assert max(trial["null_odds"]) < 14.0, "it was 23"
    assert trial["wrong"] == 0
