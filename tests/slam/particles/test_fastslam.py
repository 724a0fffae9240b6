"""The particles: what one scan does to poses, weights and maps."""

import math

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.observations import IDENTITIES_PER_SCAN, MOST_FEATURES, MatchVerdict
from slam.particles.fastslam import FastSlam, weighted_mean
from slam.settings.slam import SlamSettings
from slam.visibility import SightLine, field_of_view
from tests.support.slam.scenes import POSTS_M, arc_pose, increment_of, seen_from, settings_of

PROPOSALS = ["motion", "ekf", "unscented"]


def particles(settings: SlamSettings, seed: int = 1) -> FastSlam:
    return FastSlam(settings, np.random.default_rng(seed))


def after_standing(settings: SlamSettings, scans: int = 5, seed: int = 1) -> FastSlam:
    """Particles that have seen the posts from the origin without moving."""
    filter_ = particles(settings, seed)
    for _ in range(scans):
        filter_.step(increment_of(), seen_from(np.zeros(3), POSTS_M))
    return filter_


def drive(filter_: FastSlam, steps: int, seed: int = 0, posts: FloatArray = POSTS_M) -> FloatArray:
    """Drive an arc with noisy odometry and exact features; returns the true poses (steps, 3)."""
    generator = np.random.default_rng(seed)
    truth, poses = np.zeros(3), []
    for _ in range(steps):
        truth = arc_pose(truth, 0.1, 0.02)
        measured = arc_pose(np.zeros(3), 0.1, 0.02) + 0.03 * generator.normal(size=3) * (1.0, 1.0, 0.2)
        x, y, heading = (float(value) for value in measured)
        filter_.step(increment_of(x, y, heading, sigma=0.03), seen_from(truth, posts))
        poses.append(truth)
    return np.array(poses)


@pytest.mark.parametrize("proposal", PROPOSALS)
def test_every_proposal_follows_a_course_far_better_than_its_odometry(proposal: str) -> None:
    filter_ = after_standing(settings_of(proposal=proposal, particles=40))
    truth = drive(filter_, 80)[-1]
    mean, _ = filter_.mean()
    assert math.hypot(mean.x_m - truth[0], mean.y_m - truth[1]) < 0.1
    assert filter_.store.count_of(filter_.best) == len(POSTS_M)


def test_on_the_move_a_feature_without_a_licence_matches_but_creates_nothing() -> None:
    filter_ = after_standing(settings_of())
    more = np.vstack((POSTS_M, (4.0, -2.0)))
    outcome = filter_.step(increment_of(0.1, sigma=0.01), seen_from(np.array((0.1, 0, 0)), more, may_create=False))
    assert (outcome.matches[:-1] >= 0).all()
    assert outcome.matches[-1] == MatchVerdict.UNLICENSED
    assert filter_.store.count_of(0) == len(POSTS_M)


def test_landmark_identities_are_the_same_in_every_particle_and_tell_scan_and_feature() -> None:
    filter_ = after_standing(settings_of(), scans=1)
    drive(filter_, 1)
    filter_.step(increment_of(sigma=0.01), seen_from(filter_.poses[0], np.array(((-3.0, 2.0), (-5.0, -4.0)))))
    expected = [*range(len(POSTS_M)), 2 * IDENTITIES_PER_SCAN, 2 * IDENTITIES_PER_SCAN + 1]
    for particle in range(20):
        assert filter_.store.map_of(particle).identities.tolist() == expected


def test_matches_belong_to_this_scan_and_not_to_the_one_before() -> None:
    filter_ = after_standing(settings_of())
    outcome = filter_.step(increment_of(), seen_from(np.zeros(3), POSTS_M[::-1][:4]))
    assert outcome.matches.tolist() == [5, 4, 3, 2]


def test_without_motion_noise_every_particle_stays_where_it_is() -> None:
    filter_ = after_standing(settings_of(), scans=20)
    assert not filter_.poses.any()


def test_a_landmark_that_is_gone_is_removed_and_one_out_of_view_is_kept() -> None:
    filter_ = after_standing(settings_of())
    behind = np.vstack((POSTS_M, (-9.0, 0.5)))
    for _ in range(3):
        filter_.step(increment_of(), seen_from(np.zeros(3), behind))
    ahead = field_of_view(20.0, math.radians(130.0))
    for _ in range(30):
        filter_.step(increment_of(), seen_from(np.zeros(3), POSTS_M[1:]), ahead)
    means = filter_.store.map_of(filter_.best).means_m
    assert not (np.hypot(*(means - POSTS_M[0]).T) < 0.5).any()
    assert (np.hypot(*(means - (-9.0, 0.5)).T) < 0.5).any()


def test_without_the_existence_technique_nothing_is_removed() -> None:
    filter_ = after_standing(settings_of(techniques={"existence": False}))
    for _ in range(30):
        filter_.step(increment_of(), seen_from(np.zeros(3), POSTS_M[1:]))
    assert filter_.store.count_of(0) == len(POSTS_M)


def sight_of(distance_m: float) -> SightLine:
    """A scan of 541 beams over 270 deg, all of one range."""
    step = math.radians(0.5)
    return SightLine(-270 * step, step, 60.0, np.full(541, distance_m))


@pytest.mark.parametrize(("beams_end_at_m", "kept"), [(3.0, 1), (10.0, 1), (30.0, 0), (math.nan, 0)])
def test_only_beams_that_pass_a_landmark_speak_against_it(beams_end_at_m: float, kept: int) -> None:
    filter_ = particles(settings_of())
    post = np.array(((10.0, 0.0),))
    filter_.step(increment_of(), seen_from(np.zeros(3), post))
    for _ in range(20):
        filter_.step(increment_of(), seen_from(np.zeros(3), post[:0]), sight_of(beams_end_at_m))
    assert filter_.store.count_of(0) == kept


def test_particles_that_resample_keep_their_own_maps_and_the_right_survivors() -> None:
    settings = settings_of(particles=30, resample_share=1.0)
    filter_ = after_standing(settings)
    drive(filter_, 40)
    for particle in range(30):
        landmarks = filter_.store.map_of(particle)
        gaps = landmarks.means_m - POSTS_M[landmarks.identities % IDENTITIES_PER_SCAN]
        assert np.hypot(*gaps.T).max() < 0.3


def test_proposed_estimation_saves_nine_likelihoods_in_ten() -> None:
    """The paper's saving, counted and not timed: all off against all on, on a field much larger than the view."""
    off = dict.fromkeys(("difference", "sparse", "density", "existence", "exclusivity", "range"), False)
    grid = np.stack(np.meshgrid(np.arange(-60.0, 61.0, 8.0), np.arange(-60.0, 61.0, 8.0)), axis=-1).reshape(-1, 2)
    spent = []
    for techniques in ({}, off):
        filter_ = particles(settings_of(particles=3, techniques=techniques, view={"range_max_m": 300.0}))
        for part in np.array_split(grid, len(grid) // MOST_FEATURES):
            filter_.step(increment_of(), seen_from(np.zeros(3), part, range_max_m=300.0))
        near = grid[np.hypot(*grid.T) < 25.0]
        spent.append(filter_.step(increment_of(0.1, sigma=0.02), seen_from(np.array((0.1, 0, 0)), near)).likelihoods)
    assert spent[1] == 3 * len(near) * len(grid)
    assert spent[0] < 0.1 * spent[1]


def test_a_scan_without_features_still_moves_every_particle() -> None:
    filter_ = after_standing(settings_of())
    filter_.step(increment_of(1.0, sigma=0.05), seen_from(np.zeros(3), POSTS_M[:0]))
    assert filter_.poses[:, 0].mean() == pytest.approx(1.0, abs=0.1)
    assert filter_.poses[:, 0].std() == pytest.approx(0.05, abs=0.03)


def test_known_identities_survive_posts_that_stand_too_close_to_tell_apart() -> None:
    settings = settings_of(association={"strategy": "known"})
    filter_ = particles(settings)
    twins = np.array(((6.0, 0.0), (6.02, 0.01), (9.0, 4.0)))
    names = np.array((40, 12, 7))
    for _ in range(3):
        outcome = filter_.step(increment_of(), seen_from(np.zeros(3), twins, names))
    assert outcome.matches.tolist() == [40, 12, 7]
    assert filter_.store.map_of(0).identities.tolist() == [7, 12, 40]


@pytest.mark.parametrize("count", [1, 7, 23])
def test_any_number_of_particles_works(count: int) -> None:
    filter_ = after_standing(settings_of(particles=count, resample_share=1.0))
    drive(filter_, 10)
    assert filter_.poses.shape == (count, 3)
    assert filter_.weights.sum() == pytest.approx(1.0)


def test_the_store_grows_over_a_long_course_and_far_landmarks_stay() -> None:
    filter_ = particles(settings_of(particles=5))
    for step in range(60):
        pose = np.array((20.0 * step, 0.0, 0.0))
        filter_.step(increment_of(20.0 if step else 0.0, sigma=1e-4), seen_from(pose, pose[:2] + POSTS_M))
    assert filter_.store.count_of(0) == 60 * len(POSTS_M)
    np.testing.assert_allclose(filter_.store.map_of(4).means_m[:6], POSTS_M, atol=0.02)


def test_the_mean_heading_is_taken_round_the_circle() -> None:
    poses = np.array(((0.0, 0.0, math.pi - 0.1), (0.0, 0.0, -math.pi + 0.1)))
    mean, covariance = weighted_mean(poses, np.array((0.5, 0.5)))
    assert abs(mean.heading_rad) == pytest.approx(math.pi)
    assert covariance[2, 2] == pytest.approx(0.01)


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not() -> None:
    first, second, other = (after_standing(settings_of(), seed=seed) for seed in (3, 3, 4))
    for filter_ in (first, second, other):
        drive(filter_, 20)
    assert first.poses.tobytes() == second.poses.tobytes()
    assert first.store.map_of(0).means_m.tobytes() == second.store.map_of(0).means_m.tobytes()
    assert first.poses.tobytes() != other.poses.tobytes()
