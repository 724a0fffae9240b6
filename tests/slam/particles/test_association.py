"""Which feature is which landmark."""

import math

import numpy as np
import pytest

from drivers.measurements import FloatArray, IntArray
from slam.observations import FeatureRows, Features, MatchVerdict, usable_rows
from slam.particles.association import (
    Candidates,
    associate_by_identity,
    associate_sequentially,
    associate_simultaneously,
    candidates_of,
)
from slam.particles.gates import GATE_BLOCK, all_outside, gate_columns, match_bound
from slam.particles.proposals import PoseBelief
from slam.settings.tuning import Tuning
from tests.support.slam.scenes import settings_of

MOUNT = np.zeros(3)
VARIANCE_M2, VARIANCE_RAD2 = 0.01, 0.0004


def landmarks(*points: tuple[float, float], variance: float = 0.01) -> FloatArray:
    return np.array([(x, y, variance, 0.0, variance, 1.0) for x, y in points]).reshape(-1, 6)


def features(*points: tuple[float, float], licensed: bool = True, turned_rad: float = 0.0) -> FeatureRows:
    """Features of points from a pose at the origin that is turned."""
    array, count = np.array(points).reshape(-1, 2), len(points)
    bearings = np.arctan2(array[:, 1], array[:, 0]) - turned_rad
    noise = np.tile(np.diag((VARIANCE_M2, VARIANCE_RAD2)), (count, 1, 1))
    unknown = np.full(count, -1)
    seen = Features(0, np.hypot(*array.T), bearings, noise, np.full(count, licensed), unknown, unknown)
    return usable_rows(seen, 100.0, 0.0)


def at_origin(sigma: float) -> PoseBelief:
    return PoseBelief(np.zeros(3), np.diag((sigma**2, sigma**2, (0.2 * sigma) ** 2)), np.empty((3, 3)))


def candidates_at(numbers: FloatArray, identities: IntArray | None = None) -> Candidates:
    return candidates_of(numbers, np.arange(len(numbers)) if identities is None else identities)


def sequentially(
    rows: FeatureRows, numbers: FloatArray, tuning: Tuning, sigma: float = 0.05
) -> tuple[list[int], FloatArray, float, int]:
    belief = at_origin(sigma)
    chosen = np.empty(rows.ranges_m.size, dtype=np.int64)
    log_weight, evaluated = associate_sequentially(belief, MOUNT, candidates_at(numbers), rows, tuning, chosen)
    return chosen.tolist(), belief.pose, log_weight, evaluated


def test_two_features_on_one_landmark_leave_it_to_the_better_whichever_comes_first() -> None:
    """In published code the last one wins."""
    tuning = settings_of().tuning()
    candidates = landmarks((10.0, 0.0), (0.0, 20.0))
    near_first = sequentially(features((9.85, 0.0), (10.01, 0.0)), candidates, tuning)[0]
    better_first = sequentially(features((10.0, 0.0), (10.15, 0.0)), candidates, tuning)[0]
    assert near_first[1] == 0
    assert near_first[0] < 0
    assert better_first[0] == 0
    assert better_first[1] < 0


def test_metres_and_radians_are_never_mixed() -> None:
    """Half a radian at 20 m is 10 m away; a mixed distance takes it for nearer than 0.6 m in range."""
    tuning = settings_of().tuning()
    candidates = landmarks((20.6, 0.0), (20.0 * math.cos(0.5), 20.0 * math.sin(0.5)), variance=0.05)
    assert sequentially(features((20.0, 0.0)), candidates, tuning)[0] == [0]


def test_the_pose_moves_between_matches_so_that_a_far_feature_finds_its_landmark() -> None:
    """A heading error of 6 deg puts the far post nearer to a wrong landmark; the near posts set that right first."""
    settings = settings_of()
    posts = ((4.0, 0.0), (6.0, 2.0), (28.0, 0.0))
    turned = 0.1
    candidates = landmarks(*posts, (28.0 * math.cos(0.09), -28.0 * math.sin(0.09)), variance=1e-4)
    seen = features(*posts, turned_rad=turned)
    belief = PoseBelief(np.zeros(3), np.diag((1e-4, 1e-4, 0.06**2)), np.empty((3, 3)))
    chosen = np.empty(3, dtype=np.int64)
    associate_sequentially(belief, MOUNT, candidates_at(candidates), seen, settings.tuning(), chosen)
    assert chosen.tolist() == [0, 1, 2]
    assert belief.pose[2] == pytest.approx(turned, abs=0.01)


def test_a_feature_far_from_everything_is_new_if_licensed_and_nothing_if_not() -> None:
    tuning = settings_of().tuning()
    candidates = landmarks((10.0, 0.0), (12.0, 5.0))
    assert sequentially(features((5.0, -9.0)), candidates, tuning)[0] == [MatchVerdict.NEW]
    assert sequentially(features((5.0, -9.0), licensed=False), candidates, tuning)[0] == [MatchVerdict.UNLICENSED]


def test_every_unmatched_feature_costs_the_same_fixed_likelihood() -> None:
    tuning = settings_of().tuning()
    _, _, log_weight, _ = sequentially(features((5.0, 5.0), (9.0, -4.0), (3.0, 0.0)), landmarks(), tuning)
    assert log_weight == pytest.approx(3 * tuning.log_unmatched)


def test_the_threshold_tightens_where_landmarks_are_dense_and_has_a_floor() -> None:
    tuning = settings_of().tuning()
    dense = match_bound(landmarks((0.0, 0.0), (0.5, 0.0)), 0, tuning)
    sparse = match_bound(landmarks((0.0, 0.0), (4.0, 0.0)), 0, tuning)
    lonely = match_bound(landmarks((0.0, 0.0)), 0, tuning)
    assert dense == pytest.approx(tuning.match_square + tuning.match_per_metre_square * 0.5)
    assert dense < sparse < lonely
    assert lonely == pytest.approx(tuning.match_widest_square)


def test_without_the_density_technique_the_gate_is_the_fixed_one() -> None:
    tuning = settings_of(techniques={"density": False}).tuning()
    assert match_bound(landmarks((0.0, 0.0), (0.5, 0.0)), 0, tuning) == pytest.approx(9.21)


def test_the_range_technique_saves_likelihoods_and_changes_no_match() -> None:
    generator = np.random.default_rng(4)
    points = [(float(x), float(y)) for x, y in generator.uniform(-25, 25, (60, 2))]
    seen = features(*points[:12])
    with_range, _, weight, few = sequentially(seen, landmarks(*points), settings_of().tuning())
    without, _, same_weight, many = sequentially(
        seen, landmarks(*points), settings_of(techniques={"range": False}).tuning()
    )
    assert with_range == without
    assert weight == pytest.approx(same_weight)
    assert many >= 12 * 60
    assert few < 0.1 * many


def test_the_printed_form_lets_several_features_share_a_landmark_and_exclusivity_ends_that() -> None:
    numbers, seen = landmarks((10.0, 0.0), (0.0, 20.0)), features((9.9, 0.0), (10.0, 0.0))
    chosen = np.empty(2, dtype=np.int64)
    shared = settings_of(techniques={"exclusivity": False}).tuning()
    associate_simultaneously(at_origin(0.01), MOUNT, candidates_at(numbers), seen, shared, chosen)
    assert chosen.tolist() == [0, 0]
    exclusive = settings_of(association={"strategy": "simultaneous"}).tuning()
    associate_simultaneously(at_origin(0.01), MOUNT, candidates_at(numbers), seen, exclusive, chosen)
    assert chosen[1] == 0
    assert chosen[0] < 0


def test_known_identities_match_whatever_is_nearer_and_unknown_ones_are_left_alone() -> None:
    candidates = candidates_at(landmarks((10.0, 0.0), (10.5, 0.0)), np.array((7, 9)))
    seen = features((10.4, 0.0), (10.0, 0.0), (3.0, 3.0))._replace(identities=np.array((7, -1, 12)))
    chosen = np.empty(3, dtype=np.int64)
    tuning = settings_of(association={"strategy": "known"}).tuning()
    associate_by_identity(at_origin(0.1), MOUNT, candidates, seen, tuning, chosen)
    assert chosen.tolist() == [0, MatchVerdict.UNLICENSED, MatchVerdict.NEW]


def test_a_singular_prediction_matches_nothing_and_leaves_the_pose_finite() -> None:
    candidates = landmarks((10.0, 0.0), variance=0.0)
    seen = features((10.0, 0.0))._replace(rr=np.zeros(1), rb=np.zeros(1), bb=np.zeros(1))
    chosen, pose, log_weight, _ = sequentially(seen, candidates, settings_of().tuning(), sigma=0.0)
    assert chosen[0] < 0
    assert np.isfinite(pose).all()
    assert math.isfinite(log_weight)


@pytest.mark.parametrize("count", [1, GATE_BLOCK - 1, GATE_BLOCK, 3 * GATE_BLOCK + 5])
def test_a_block_of_candidates_is_passed_over_only_if_none_of_them_is_inside_the_gate(count: int) -> None:
    generator = np.random.default_rng(count)
    candidates = landmarks(*((float(x), float(y)) for x, y in generator.uniform(-9, 9, (count, 2))))
    columns, bound, variance, over = gate_columns(candidates), 50.0, 0.02, 0
    for x, y in generator.uniform(-9, 9, (200, 2)):
        squares = ((candidates[:, :2] - (x, y)) ** 2).sum(axis=1)
        inside = squares <= bound * (variance + candidates[:, 2] + candidates[:, 4])
        for first in range(0, count, GATE_BLOCK):
            outside = all_outside(columns, first, x, y, variance, bound)
            assert outside == (not inside[first : first + GATE_BLOCK].any())
            over += outside
    assert over > 0
