import numpy as np

from slam.particles.fastslam import FastSlam
from tests.support.slam.scenes import POSTS_M, increment_of, seen_from, settings_of

PARTICLES = 200


def test_particles_are_drawn_from_the_gaussian_each_with_the_map_that_goes_with_its_pose() -> None:
    """The landmarks are known from the pose: where a particle stands elsewhere, so do they."""
    filter_ = FastSlam(settings_of(particles=PARTICLES), np.random.default_rng(1))
    filter_.step(increment_of(), seen_from(np.zeros(3), POSTS_M))
    count = len(POSTS_M)
    pose = np.array((20.0, -10.0, 0.0))
    mean = np.concatenate((pose, (POSTS_M + pose[:2]).ravel()))
    by_pose = np.zeros((2 * count, 3))
    by_pose[0::2, 0] = by_pose[1::2, 1] = 1.0
    spread = np.diag((0.3**2, 0.2**2, 0.01**2))
    covariance = np.block(
        [[spread, spread @ by_pose.T], [by_pose @ spread, by_pose @ spread @ by_pose.T + 1e-3 * np.eye(2 * count)]]
    )
    filter_.redraw(mean, covariance, np.arange(7, 7 + count), np.full(count, 3.0))
    assert np.allclose(filter_.poses.mean(axis=0), pose, atol=0.1)
    assert np.allclose(filter_.poses.std(axis=0), (0.3, 0.2, 0.01), rtol=0.25)
    for particle in (0, PARTICLES - 1):
        found = filter_.store.map_of(particle)
        assert found.identities.tolist() == list(range(7, 7 + count))
        assert np.allclose(found.means_m - filter_.poses[particle, :2], POSTS_M, atol=0.02)
        assert np.allclose(found.covariances_m2, 1e-3 * np.eye(2), atol=1e-5)
    outcome = filter_.step(increment_of(), seen_from(pose, POSTS_M + pose[:2]))
    assert (outcome.matches >= 7).sum() > 0.8 * count
    assert (outcome.matches < 7 + count).all()


def test_without_landmarks_there_are_poses_alone() -> None:
    filter_ = FastSlam(settings_of(particles=5), np.random.default_rng(1))
    filter_.redraw(np.ones(3), np.zeros((3, 3)), np.empty(0, dtype=np.int64), np.empty(0))
    assert (filter_.poses == 1.0).all()
    assert filter_.store.count_of(0) == 0
