import numpy as np

from slam.joint.gaussian import JointGaussian
from slam.observations import IDENTITIES_PER_SCAN
from slam.pose import Pose2
from slam.recognise.local_points import local_points
from slam.recognise.scale import Scale
from slam.settings.joint import JointSettings
from tests.slam.joint.test_gaussian import RING, STEP_NOISE, TUNING, features_at, look, seen_from, unknown

LATER = [(9.0, 5.0), (-6.0, 3.0)]


def drive() -> JointGaussian:
    """Six things, a keyframe, five metres ahead, then two things more."""
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, RING, 5)
    joint.add_keyframe()
    joint.predict(np.array((5.0, 0.0, 0.3)), STEP_NOISE)
    joint.predict(np.zeros(3), np.zeros((3, 3)))
    for _ in range(3):
        seen = features_at([*seen_from(joint.map_from_body, RING), *LATER])
        joint.observe(seen, unknown(seen), begins=True)
    return joint


def test_points_are_the_landmarks_as_the_body_sees_them() -> None:
    joint = drive()
    points = local_points(joint.state, Scale(0.2))
    expected = np.array([*seen_from(joint.map_from_body, RING), *LATER])
    assert np.allclose(np.sort(points.points_m, axis=0), np.sort(expected, axis=0), atol=0.05)
    assert len(local_points(joint.state, Scale(0.2), 5)) == len(LATER)
    assert (local_points(joint.state, Scale(0.2), 5).identities >= 5 * IDENTITIES_PER_SCAN).all()


def test_their_covariance_is_that_of_samples_of_the_state() -> None:
    joint = drive()
    points = local_points(joint.state, Scale(0.2))
    state, generator = joint.state, np.random.default_rng(1)
    rows = {int(state.atlas.identities[row]): 6 + 2 * number for number, row in enumerate(state.rows)}
    places = [rows[identity] for identity in points.identities.tolist()]
    samples = []
    for sample in generator.multivariate_normal(
        state.mean[: state.size], state.covariance[: state.size, : state.size], 4000
    ):
        seen = Pose2(*sample[:3].tolist()).inverse().transform(np.array([sample[at : at + 2] for at in places]))
        samples.append(seen.ravel())
    assert np.allclose(np.cov(np.array(samples).T), points.covariance_m2, atol=0.1 * points.covariance_m2.max())


def test_what_is_not_exact_from_here_is_left_out() -> None:
    joint = drive()
    joint.predict(np.zeros(3), np.diag((4.0, 4.0, 0.01)))
    assert len(local_points(joint.state, Scale(0.2))) == 0
