import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import FloatArray
from slam.joint import state as state_module
from slam.joint.kernels import append, forget
from slam.joint.measurement import FIRST_PLACE
from slam.joint.state import MOST_RETURNING, JointState
from slam.joint.window import least_needed, regress, restore
from slam.observations import Sighting
from slam.settings.joint import JointSettings
from tests.support.examples import examples

SIGHTING = Sighting(5.0, 0.3, 0.01, 0.0, 0.0003)


def spread_out(seed: int, landmarks: int) -> tuple[FloatArray, FloatArray]:
    """mean (n,) and a covariance (n, n) of full rank."""
    generator = np.random.default_rng(seed)
    n = FIRST_PLACE + 2 * landmarks
    root = generator.normal(size=(n, n))
    return generator.normal(size=n) * 20.0, root @ root.T / n + 0.01 * np.eye(n)


@examples(30)
@given(seed=st.integers(0, 10**6), others=st.integers(1, 4))
def test_a_landmark_that_leaves_and_returns_keeps_its_covariance_with_itself_and_its_parents(
    seed: int, others: int
) -> None:
    _, covariance = spread_out(seed, 5)
    at = FIRST_PLACE + 8
    places = FIRST_PLACE + 2 * np.arange(others)
    weights, residual = np.zeros((2, 2 * others)), np.zeros((2, 2))
    regress(covariance, at, places, weights, residual)
    restored = covariance.copy()
    restore(restored, at, places, weights, residual)
    entries = np.concatenate((places, places + 1, (at, at + 1)))
    assert np.allclose(restored[np.ix_(entries, entries)], covariance[np.ix_(entries, entries)], atol=1e-6)
    assert np.array_equal(restored, restored.T)
    assert np.linalg.eigvalsh(restored)[0] > 0.0


def test_the_one_that_leaves_is_the_crowded_one_far_away() -> None:
    mean = np.zeros(FIRST_PLACE + 10)
    mean[FIRST_PLACE:] = (5.0, 0.0, 5.5, 0.0, 100.0, 0.0, 104.0, 0.0, 0.0, 120.0)
    assert least_needed(mean, mean.size, np.array((False, False, True, True, True))) == 3
    assert least_needed(mean, mean.size, np.zeros(5, dtype=np.bool_)) == -1


def test_forgetting_a_landmark_leaves_all_others_as_they_were() -> None:
    mean, covariance = spread_out(1, 4)
    before, covariance_before = mean.copy(), covariance.copy()
    forget(mean, covariance, mean.size, FIRST_PLACE + 2)
    order = np.concatenate((np.arange(FIRST_PLACE + 2), FIRST_PLACE + np.array((6, 7, 4, 5))))
    left = mean.size - 2
    assert np.array_equal(mean[:left], before[order])
    assert np.array_equal(covariance[:left, :left], covariance_before[np.ix_(order, order)])


def test_a_new_landmark_is_correlated_with_the_pose_as_a_sampled_one_is() -> None:
    generator = np.random.default_rng(0)
    root = generator.normal(size=(3, 3)) * np.array((0.1, 0.1, 0.02))[:, np.newaxis]
    mean, covariance = np.zeros(FIRST_PLACE + 2), np.zeros((FIRST_PLACE + 2, FIRST_PLACE + 2))
    mean[:3] = (1.0, 2.0, 0.7)
    covariance[:3, :3] = root @ root.T
    mount = np.array((0.5, -0.2, 0.3))
    append(mean, covariance, FIRST_PLACE, mount, SIGHTING)
    poses = mean[:3] + generator.standard_normal((200_000, 3)) @ root.T
    ranges = SIGHTING.range_m + math.sqrt(SIGHTING.rr) * generator.standard_normal(len(poses))
    bearings = SIGHTING.bearing_rad + math.sqrt(SIGHTING.bb) * generator.standard_normal(len(poses))
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    angle = poses[:, 2] + mount[2] + bearings
    x = poses[:, 0] + cosine * mount[0] - sine * mount[1] + ranges * np.cos(angle)
    y = poses[:, 1] + sine * mount[0] + cosine * mount[1] + ranges * np.sin(angle)
    sampled = np.cov(np.column_stack((poses, x, y)).T)
    entries = np.array((0, 1, 2, FIRST_PLACE, FIRST_PLACE + 1))
    assert np.allclose(covariance[np.ix_(entries, entries)], sampled, atol=3e-4)


def row_of_posts(posts: int = 80) -> JointState:
    """A state along a road with a landmark every 5 m, driven to its end; where it began is known to 100 m only."""
    state = JointState(JointSettings(landmarks_in_state=12), reach_m=20.0, cell_m=15.0)
    state.covariance[0, 0] = state.covariance[1, 1] = 1e4
    mount = np.zeros(3)
    for index in range(posts):
        state.bring_back()
        state.create(index, 6.0, mount, Sighting(3.0, 1.0, 0.01, 0.0, 0.0003))
        for _ in range(3):
            state.put_away()
        state.mean[0] += 5.0
        state.covariance[0, 0] += 0.05**2
        state.covariance[2, 2] += 0.002**2
        for column in range(state.size):
            state.covariance[1, column] += 5.0 * state.covariance[2, column]
        for row in range(state.size):
            state.covariance[row, 1] += 5.0 * state.covariance[row, 2]
    return state


def test_the_state_stays_small_and_the_map_whole() -> None:
    state = row_of_posts()
    assert state.count <= 16
    assert state.atlas.count == 80
    means = state.settled_means()
    assert np.allclose(np.sort(means[:80, 0]), 3.0 * math.cos(1.0) + 5.0 * np.arange(80), atol=1e-9)


def test_landmarks_far_away_follow_when_the_map_moves() -> None:
    state = row_of_posts()
    before = state.settled_means().copy()
    state.mean[FIRST_PLACE : state.size : 2] += 2.0
    moved = state.settled_means() - before
    away = np.flatnonzero(state.atlas.place == -1)
    assert len(away) > 60
    assert np.allclose(moved[:80, 0], 2.0, atol=0.1)


def test_landmarks_come_back_when_the_rover_returns() -> None:
    state = row_of_posts()
    state.mean[:3] = 0.0
    state.bring_back()
    near = [index for index in range(80) if state.atlas.place[index] >= 0 and 5.0 * index < 20.0]
    assert len(near) == 4
    size = state.size
    assert np.linalg.eigvalsh(state.covariance[:size, :size]).min() > -1e-9
    assert np.array_equal(state.covariance[:size, :size], state.covariance[:size, :size].T)


def test_a_loop_closed_through_a_long_chain_brings_back_what_is_near_and_no_more_than_fits() -> None:
    state = row_of_posts(500)
    before, believed = state.settled_means(), state.atlas.covariances.copy()
    state.mean[:3] = 0.0
    state.bring_back()
    assert all(state.atlas.place[index] >= 0 for index in range(4))
    assert state.count <= MOST_RETURNING + 16
    size = state.size
    assert np.linalg.eigvalsh(state.covariance[:size, :size]).min() > -1e-9
    assert np.allclose(state.settled_means(), before, atol=1e-9)
    alone = [row for row in state.rows if (state.atlas.parents[row] < 0).all() and 5.0 * row > 500.0 and row < 480]
    assert alone  # the last of those that returned hang on nothing, and are believed half as much for it
    for row in alone:
        at = int(state.atlas.place[row])
        assert np.allclose(state.covariance[at : at + 2, at : at + 2], 2.0 * believed[row])


def test_what_hung_on_a_removed_landmark_stands_alone() -> None:
    state = row_of_posts()
    carriers = [number for number, row in enumerate(state.rows) if (state.atlas.parents == row).any()]
    assert carriers
    row = int(state.rows[carriers[0]])
    children = np.flatnonzero((state.atlas.parents == row).any(axis=1))
    state.remove(carriers[0])
    assert (state.atlas.parents[children] == -1).all()
    assert np.isfinite(state.settled_means()).all()
    state.mean[:3] = (float(state.atlas.means[children[0], 0]), 0.0, 0.0)
    state.bring_back()
    assert state.atlas.place[children[0]] >= 0


def test_a_map_that_moved_is_found_where_it_is_now() -> None:
    state = row_of_posts()
    state.mean[FIRST_PLACE : state.size : 2] += 30.0
    state.sort_anew()
    state.mean[:3] = (30.0, 0.0, 0.0)
    state.bring_back()
    assert all(state.atlas.place[index] >= 0 for index in range(4))
    assert state.atlas.means[0, 0] == pytest.approx(30.0 + 3.0 * math.cos(1.0), abs=1.0)


def test_the_state_has_a_bound_however_thick_landmarks_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    """A saved map may have thousands within reach: every 2 m brought 256 of them back, and none of them left."""
    monkeypatch.setattr(state_module, "MOST_IN_STATE", 40)
    state = JointState(JointSettings(landmarks_in_state=12), reach_m=20.0, cell_m=15.0)
    for index in range(200):
        state.atlas.add_away(index, 6.0, np.array((0.1 * index, 1.0)), 0.01 * np.eye(2))
    for step in range(8):
        state.mean[0] = 3.0 * step
        state.bring_back()
        assert state.count <= 40
    assert state.atlas.count == 200
