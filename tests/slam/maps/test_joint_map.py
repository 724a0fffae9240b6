"""A map outlives its drive: nothing of it is lost, nothing of the drive is in it, and a frozen one stays as it is."""

import copy
import math
from functools import cache

import numpy as np
import pytest

from drivers.measurements import FloatArray, IntArray
from slam.joint.gaussian import KEYFRAME, JointGaussian, Variant
from slam.joint.measurement import FIRST_PLACE
from slam.joint.state import JointState
from slam.joint.window import ORPHAN
from slam.maps import joint_map
from slam.maps.joint_map import JointMap, put_map, take_map, tie_pose
from slam.maps.views import BEAMS, Views
from slam.observations import FeatureRows
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from slam.visibility import field_of_view
from tests.slam.joint.test_gaussian import features_at

TUNING = SlamSettings().tuning()
STEP = np.array((1.0, 0.0, 0.0))
SIGHT = field_of_view(14.0, math.pi)
NOISE = np.diag((0.02, 0.02, 0.002)) ** 2


def posts(count: int) -> FloatArray:
    """(n, 2) to both sides of a straight road."""
    index = np.arange(count)
    return np.column_stack((3.0 * index, np.where(index % 2, 6.0, -7.0)))


def empty(variant: Variant | None = None) -> JointGaussian:
    return JointGaussian(JointSettings(landmarks_in_state=12), Pose2(), TUNING, variant or Variant())


def seen_from(x_m: float, landmarks: FloatArray) -> FeatureRows:
    near = landmarks[np.abs(landmarks[:, 0] - x_m) < 15.0]
    return features_at([(float(x - x_m), float(y)) for x, y in near])


@cache
def driven(keyframes: bool = False) -> JointGaussian:
    """150 m along a road of 60 posts, which are far more than the state holds."""
    joint, road = empty(), posts(60)
    for step in range(150):
        joint.step(STEP, NOISE, seen_from(step + 1.0, road), np.zeros(0, dtype=np.int64), SIGHT)
        if keyframes and step % 5 == 0:
            joint.add_keyframe()
    return joint


def all_in_one(state: JointState, identities: list[int]) -> FloatArray:
    """Joint covariance of these landmarks when everything has come back."""
    whole = copy.deepcopy(state)
    whole.bring_all_back()
    names = whole.atlas.identities[whole.rows].tolist()
    places = [FIRST_PLACE + 2 * names.index(identity) + axis for identity in identities for axis in range(2)]
    return whole.covariance[np.ix_(places, places)]


def test_a_map_that_was_put_into_another_filter_is_the_same_map() -> None:
    known = take_map(driven())
    assert len(known) > 40
    assert known.in_state < 30
    joint = empty()
    put_map(joint, known)
    again = take_map(joint)
    for name, array in known.arrays.items():
        assert np.array_equal(array, again.arrays[name]), name
    names = known.identities.tolist()
    assert np.array_equal(all_in_one(driven().state, names), all_in_one(joint.state, names))
    before = {int(name): mean for name, mean in zip(*_published(driven()), strict=True)}
    assert all(np.array_equal(before[int(name)], mean) for name, mean in zip(*_published(joint), strict=True))


def _published(joint: JointGaussian) -> tuple[IntArray, FloatArray]:
    landmarks = joint.landmarks()
    kept = landmarks.existence_log_odds >= 3.0
    return landmarks.identities[kept], landmarks.means_m[kept]


def test_keyframes_leave_the_map_and_landmarks_keep_their_means_and_covariances() -> None:
    joint = driven(keyframes=True)
    before = joint.state_bytes()
    known = take_map(joint)
    assert joint.state_bytes() == before, "taking a map changes nothing"
    assert KEYFRAME not in known.identities
    assert (known.parents[known.in_state :, 0] != ORPHAN).all(), "what hung on keyframes hangs on landmarks"
    means = {int(name): mean for name, mean in zip(*_published(joint), strict=True)}
    assert np.allclose(known.means_m, [means[int(name)] for name in known.identities], atol=1e-9)
    other = empty()
    put_map(other, known)
    names = known.identities.tolist()
    was, now = all_in_one(joint.state, names), all_in_one(other.state, names)
    sigmas = np.sqrt(np.diag(was))
    assert np.allclose(np.diag(now), np.diag(was), rtol=0.02)
    assert np.abs((now - was) / np.outer(sigmas, sigmas)).max() < 0.15
    assert np.linalg.eigvalsh(now)[0] > 0.0


def test_a_landmark_that_is_not_confirmed_is_in_no_map() -> None:
    joint = copy.deepcopy(driven())
    joint.observe(seen_from(150.0, np.array(((150.0, 1.0),))), np.zeros(0, dtype=np.int64))
    assert joint.landmarks().existence_log_odds.min() < 3.0
    assert take_map(joint).log_odds.min() >= 3.0


def again(frozen: bool, start: Pose2, known: JointMap) -> JointGaussian:
    """A second drive through the road in the map of the first, with three posts gone and three new ones."""
    joint = empty(Variant(jacobians="current") if frozen else None)
    put_map(joint, known, frozen)
    tie_pose(joint, start, np.diag((0.5, 0.5, 0.1)) ** 2)
    road = posts(60)
    road[[10, 25, 40]] += (1.4, 3.0)
    for step in range(120):
        joint.step(STEP, NOISE, seen_from(step + 5.0, road), np.zeros(0, dtype=np.int64), SIGHT)
    return joint


@pytest.mark.parametrize("frozen", [True, False])
def test_a_drive_that_begins_half_a_metre_wrong_in_a_map_finds_its_pose(frozen: bool) -> None:
    joint = again(frozen, Pose2(4.4, 0.4, 0.05), take_map(driven()))
    true = np.array((124.0, 0.0, 0.0))
    off = joint.map_from_body.as_array() - true
    drift = driven().map_from_body.as_array() - np.array((150.0, 0.0, 0.0))
    assert np.abs(off).max() < np.abs(drift).max() + 0.2
    assert off @ np.linalg.solve(joint.covariance, off) < 16.0


def test_localisation_only_leaves_the_saved_map_as_it_was_to_the_last_bit() -> None:
    known = take_map(driven())
    before = known.digest()
    joint = again(True, Pose2(4.4, 0.4, 0.05), known)
    assert known.digest() == before
    atlas = joint.state.atlas
    rows = {int(identity): row for row, identity in enumerate(atlas.identities) if atlas.place[row] >= -1}
    saved = np.array([rows[int(identity)] for identity in known.identities])
    assert np.array_equal(joint.state.settled_means()[saved], known.means_m), "though all have left and come back"
    assert atlas.frozen[saved].all()
    temporary = np.flatnonzero(~atlas.frozen & (atlas.place >= -1))
    assert len(temporary) >= 3, "new things are temporary landmarks"
    on = atlas.parents[saved]
    assert atlas.frozen[on[on >= 0]].all(), "saved landmarks hang on saved ones only"


def test_the_block_of_frozen_landmarks_learns_nothing_while_the_pose_does() -> None:
    known = take_map(driven())
    joint = empty(Variant(jacobians="current"))
    put_map(joint, known, frozen=True)
    tie_pose(joint, Pose2(100.2, 0.1, 0.02), np.diag((0.5, 0.5, 0.1)) ** 2)
    n = joint.state.size
    block, pose = joint.state.covariance[FIRST_PLACE:n, FIRST_PLACE:n].copy(), joint.covariance
    names = joint.state.atlas.identities[joint.state.rows].copy()
    verdicts = joint.observe(seen_from(100.0, posts(60)), np.zeros(0, dtype=np.int64))
    assert (verdicts >= 0).sum() > 5
    assert np.array_equal(joint.state.atlas.identities[joint.state.rows][: len(names)], names)
    assert np.array_equal(joint.state.covariance[FIRST_PLACE:n, FIRST_PLACE:n], block)
    assert np.linalg.det(joint.covariance) < 0.01 * np.linalg.det(pose)
    full = joint.state.covariance[: joint.state.size, : joint.state.size]
    assert np.linalg.eigvalsh(full)[0] > -1e-9


def test_a_pose_read_off_a_map_shares_the_error_of_the_landmarks_around_it() -> None:
    joint = empty()
    put_map(joint, take_map(driven()))
    spread = np.diag((0.5, 0.4, 0.1)) ** 2
    tie_pose(joint, Pose2(120.0, 0.0, 0.0), spread)
    state = joint.state
    nearest = int(np.argmin(((state.points_m - (120.0, 0.0)) ** 2).sum(axis=1)))
    at = FIRST_PLACE + 2 * nearest
    p = state.covariance
    relative = p[1, 1] - 2.0 * p[1, at + 1] + p[at + 1, at + 1]
    assert relative == pytest.approx(spread[1, 1], rel=0.2)
    assert p[1, 1] > spread[1, 1] + 0.5 * p[at + 1, at + 1]
    n = state.size
    assert np.linalg.eigvalsh(p[:n, :n])[0] > -1e-9


def test_views_beyond_the_bound_are_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each drive that begins in a map adds its own: a map that could not be read again would be the end of it."""
    monkeypatch.setattr(joint_map, "MOST_VIEWS", 4)
    poses = np.column_stack((np.arange(10.0), np.zeros((10, 2))))
    known = take_map(driven(), Views(poses, np.zeros((10, BEAMS, 2), dtype=np.int16)))
    assert known.view_poses[:, 0].tolist() == [0.0, 2.0, 5.0, 7.0]
    assert known.view_points_cm.shape == (4, BEAMS, 2)
