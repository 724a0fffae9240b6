import numpy as np

from drivers.measurements import FloatArray
from slam.joint.gaussian import JointGaussian
from slam.joint.keyframe_axis import between, between_with_covariance
from slam.joint.measurement import FIRST_PLACE
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from tests.slam.joint.test_gaussian import RING, features_at, look

MOVED = np.array((0.8, 0.1, 0.3))
NOISE = np.diag((0.1, 0.05, 0.05)) ** 2


def with_keyframe() -> JointGaussian:
    joint = JointGaussian(JointSettings(), Pose2(), SlamSettings().tuning())
    joint.predict(np.array((1.0, 2.0, 0.5)), NOISE)
    joint.add_keyframe()
    joint.predict(MOVED, NOISE)
    return joint


def test_the_body_is_seen_from_a_keyframe_as_far_off_as_it_has_moved_since() -> None:
    joint = with_keyframe()
    seen, spread = joint.from_keyframe(0)
    assert np.allclose(seen, MOVED, atol=1e-6)
    assert np.allclose(np.sqrt(np.diag(spread)), np.sqrt(np.diag(NOISE)), rtol=0.2)
    assert np.allclose(joint.from_keyframes()[0], seen)


def test_the_covariance_follows_the_derivative() -> None:
    rng = np.random.default_rng(1)
    mean = rng.normal(size=FIRST_PLACE + 4)
    root = 1e-4 * rng.normal(size=(len(mean), len(mean)))
    at = FIRST_PLACE
    _, spread, _ = between_with_covariance(mean, root @ root.T, len(mean), at, at + 2)
    draws = mean + rng.normal(size=(20_000, len(mean))) @ root.T

    def seen(state: FloatArray) -> FloatArray:
        bodies: FloatArray = between(state, state[None, at : at + 2], state[None, at + 2 : at + 4])
        return np.asarray(bodies[0])

    sampled = np.cov(np.array([seen(draw) for draw in draws]).T)
    assert np.allclose(spread, sampled, rtol=0.1, atol=1e-10)


def test_what_a_fit_says_moves_the_body_and_leaves_the_covariance_that_was_asked_for() -> None:
    joint = with_keyframe()
    off, posterior = np.array((0.02, -0.01, 0.015)), np.diag((0.01, 0.01, 0.005)) ** 2
    joint.condition(0, off, posterior)
    seen, spread = joint.from_keyframe(0)
    assert np.allclose(seen, MOVED + off, atol=3e-3)
    assert np.allclose(np.sqrt(np.diag(spread)), np.sqrt(np.diag(posterior)), rtol=0.2)
    assert (np.linalg.eigvalsh(joint.covariance) > 0.0).all()


def test_keyframes_are_no_landmarks() -> None:
    joint = with_keyframe()
    look(joint, RING, times=3)
    assert joint.landmark_count == len(RING)
    assert (joint.landmarks().identities >= 0).all()
    joint.predict(MOVED, NOISE)
    for _ in range(40):
        joint.observe(features_at([]), np.zeros(0, dtype=np.int64))
    assert np.isfinite(joint.from_keyframes()).all()
