"""Predicted measurements and the update of pose and landmark, held to plain reference forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from drivers.measurements import FloatArray
from slam.observations import Sighting
from slam.particles.landmark_filter import new_landmark, update_landmark
from slam.particles.proposals import (
    Moments,
    PoseBelief,
    fold_in,
    linearised_moments,
    log_likelihood,
    squared_distance,
    unscented_moments,
    with_noise,
)
from slam.pose import wrap_rad
from slam.settings.sigma_points import ALPHA, BETA, unscented_weights
from slam.visibility import sensor_pose
from tests.support.examples import examples
from tests.support.slam.unscented import square_root, unscented_transform

WEIGHTS_5, WEIGHTS_2 = unscented_weights(5), unscented_weights(2)
SPREAD = BETA - ALPHA**2
MOUNT = np.array((0.3, -0.1, 0.2))
NOISE = Sighting(0.0, 0.0, 0.01, 0.0005, 0.0004)
SEEDS = st.integers(0, 2**32 - 1)


def measured(pose: FloatArray, landmark: FloatArray, mount: FloatArray = MOUNT) -> FloatArray:
    """h(pose, landmark), written down once more."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    x = pose[0] + cosine * mount[0] - sine * mount[1]
    y = pose[1] + sine * mount[0] + cosine * mount[1]
    dx, dy = landmark[0] - x, landmark[1] - y
    return np.array((math.hypot(dx, dy), wrap_rad(math.atan2(dy, dx) - pose[2] - mount[2])))


def scene(seed: int, size: float = 0.05) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A pose, its covariance and a landmark (6,) some metres ahead, so that no bearing is near pi."""
    generator = np.random.default_rng(seed)
    pose = generator.normal(size=3)
    root, small = size * generator.normal(size=(3, 3)), size * generator.normal(size=(2, 2))
    direction = pose[2] + MOUNT[2] + generator.uniform(-1.5, 1.5)
    distance = generator.uniform(3.0, 20.0)
    own = small @ small.T
    place = pose[:2] + distance * np.array((math.cos(direction), math.sin(direction)))
    return pose, root @ root.T, np.array((*place, own[0, 0], own[0, 1], own[1, 1], 0.0))


def belief(pose: FloatArray, covariance: FloatArray) -> PoseBelief:
    return PoseBelief(pose, covariance, square_root(covariance))


def moments(pose: FloatArray, covariance: FloatArray, landmark: FloatArray, noise: Sighting = NOISE) -> Moments:
    return unscented_moments(belief(pose, covariance), MOUNT, landmark, noise, WEIGHTS_5, SPREAD)


def innovation_covariance(predicted: Moments) -> FloatArray:
    return np.array(((predicted.rr, predicted.rb), (predicted.rb, predicted.bb)))


def cross(predicted: Moments) -> FloatArray:
    return np.array(predicted[5:]).reshape(3, 2)


@given(SEEDS)
def test_unscented_moments_are_those_of_eleven_points(seed: int) -> None:
    pose, covariance, landmark = scene(seed)
    joint = np.zeros((5, 5))
    joint[:3, :3] = covariance
    joint[3:, 3:] = ((landmark[2], landmark[3]), (landmark[3], landmark[4]))
    mean, spread, crossed = unscented_transform(np.append(pose, landmark[:2]), joint, lambda x: measured(x[:3], x[3:]))
    predicted = moments(pose, covariance, landmark)
    np.testing.assert_allclose((predicted.range_m, predicted.bearing_rad), mean, atol=1e-9)
    noise = np.array(((NOISE.rr, NOISE.rb), (NOISE.rb, NOISE.bb)))
    np.testing.assert_allclose(innovation_covariance(predicted), spread + noise, atol=1e-9)
    np.testing.assert_allclose(cross(predicted), crossed[:3], atol=1e-9)


@given(SEEDS)
def test_linearised_moments_use_this_landmarks_own_jacobian(seed: int) -> None:
    pose, covariance, landmark = scene(seed)
    step = 1e-6
    jacobian = np.column_stack(
        [
            (measured(pose + step * axis, landmark) - measured(pose - step * axis, landmark)) / (2 * step)
            for axis in np.eye(3)
        ]
    )
    own = np.column_stack(
        [
            (measured(pose, landmark[:2] + step * axis) - measured(pose, landmark[:2] - step * axis)) / (2 * step)
            for axis in np.eye(2)
        ]
    )
    block = np.array(((landmark[2], landmark[3]), (landmark[3], landmark[4])))
    noise = np.array(((NOISE.rr, NOISE.rb), (NOISE.rb, NOISE.bb)))
    predicted = linearised_moments(belief(pose, covariance), MOUNT, landmark, NOISE)
    expected = jacobian @ covariance @ jacobian.T + own @ block @ own.T + noise
    np.testing.assert_allclose(innovation_covariance(predicted), expected, atol=1e-7)
    np.testing.assert_allclose(cross(predicted), covariance @ jacobian.T, atol=1e-7)
    np.testing.assert_allclose((predicted.range_m, predicted.bearing_rad), measured(pose, landmark), atol=1e-12)


@given(SEEDS)
def test_both_proposals_agree_where_the_pose_is_nearly_certain(seed: int) -> None:
    pose, covariance, landmark = scene(seed, size=1e-4)
    ekf = linearised_moments(belief(pose, covariance), MOUNT, landmark, NOISE)
    np.testing.assert_allclose(moments(pose, covariance, landmark), ekf, atol=1e-6)


@given(SEEDS)
def test_the_likelihood_has_the_whole_determinant_under_the_root(seed: int) -> None:
    pose, covariance, landmark = scene(seed)
    predicted = moments(pose, covariance, landmark)
    sighting = NOISE._replace(range_m=predicted.range_m + 0.2, bearing_rad=predicted.bearing_rad - 0.03)
    expected = multivariate_normal.logpdf((0.2, -0.03), cov=innovation_covariance(predicted))
    assert log_likelihood(predicted, squared_distance(predicted, sighting)) == pytest.approx(expected, rel=1e-9)


def test_the_weight_of_one_landmark_counts_the_pose_covariance_once() -> None:
    pose, landmark = np.zeros(3), np.array((10.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    covariance = np.diag((0.04, 0.0, 0.0))
    predicted = unscented_moments(belief(pose, covariance), np.zeros(3), landmark, NOISE, WEIGHTS_5, SPREAD)
    assert predicted.rr == pytest.approx(0.04 + NOISE.rr)


def test_only_bearings_wrap_and_never_ranges() -> None:
    predicted = Moments(10.0, 3.1, 1.0, 0.0, 0.01, 0, 0, 0, 0, 0, 0)
    far = Sighting(14.0, 3.1, 0, 0, 0)
    assert squared_distance(predicted, far) == pytest.approx(16.0)
    across = Sighting(10.0, -3.1, 0, 0, 0)
    assert squared_distance(predicted, across) == pytest.approx((2 * math.pi - 6.2) ** 2 / 0.01)


def test_a_landmark_behind_the_sensor_pulls_the_pose_no_way_round() -> None:
    pose, covariance = np.zeros(3), np.diag((0.01, 0.01, 0.001))
    landmark = np.array((-8.0, 1e-3, 0.01, 0.0, 0.01, 0.0))
    predicted = unscented_moments(belief(pose, covariance), np.zeros(3), landmark, NOISE, WEIGHTS_5, SPREAD)
    sighting = NOISE._replace(range_m=8.0, bearing_rad=-math.pi + 1e-3)
    fold_in(belief(pose, covariance), predicted, sighting)
    assert abs(pose[2]) < 0.01


def test_folding_in_is_the_kalman_update_and_stays_symmetric() -> None:
    pose, covariance, landmark = scene(5)
    predicted = moments(pose, covariance, landmark)
    sighting = NOISE._replace(range_m=predicted.range_m + 0.1, bearing_rad=predicted.bearing_rad + 0.01)
    gain = cross(predicted) @ np.linalg.inv(innovation_covariance(predicted))
    expected = pose + gain @ (0.1, 0.01)
    expected_covariance = covariance - gain @ innovation_covariance(predicted) @ gain.T
    fold_in(belief(pose, covariance), predicted, sighting)
    np.testing.assert_allclose(pose, expected, atol=1e-12)
    np.testing.assert_allclose(covariance, expected_covariance, atol=1e-12)
    assert np.array_equal(covariance, covariance.T)


def test_every_landmark_gets_fresh_sigma_points() -> None:
    """Published code draws the points once and re-uses their columns: the second landmark then sees the pose of
    before.
    """
    pose, covariance, first = scene(11, size=0.2)
    second = first.copy()
    second[:2] += (3.0, -2.0)
    expected_pose, expected_covariance = pose.copy(), covariance.copy()
    for landmark in (first, second):
        sighting = NOISE._replace(range_m=float(np.hypot(*landmark[:2])), bearing_rad=0.1)
        block = np.zeros((5, 5))
        block[:3, :3] = expected_covariance
        block[3:, 3:] = ((landmark[2], landmark[3]), (landmark[3], landmark[4]))
        mean, spread, crossed = unscented_transform(
            np.append(expected_pose, landmark[:2]), block, lambda x: measured(x[:3], x[3:])
        )
        spread += ((NOISE.rr, NOISE.rb), (NOISE.rb, NOISE.bb))
        gain = crossed[:3] @ np.linalg.inv(spread)
        innovation = np.array((sighting.range_m - mean[0], wrap_rad(sighting.bearing_rad - mean[1])))
        expected_pose = expected_pose + gain @ innovation
        expected_covariance = expected_covariance - gain @ spread @ gain.T
        fold_in(belief(pose, covariance), moments(pose, covariance, landmark), sighting)
    np.testing.assert_allclose(pose[:2], expected_pose[:2], atol=1e-9)
    assert wrap_rad(pose[2] - expected_pose[2]) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(covariance, expected_covariance, atol=1e-9)


@examples(60)
@given(SEEDS, st.integers(1, 40))
def test_covariances_stay_positive_however_many_landmarks_are_folded_in(seed: int, landmarks: int) -> None:
    generator = np.random.default_rng(seed)
    pose, covariance, landmark = scene(seed, size=generator.choice((1e-4, 0.05, 0.5)))
    for _ in range(landmarks):
        landmark[:2] += generator.normal(size=2)
        predicted = moments(pose, covariance, landmark)
        noisy = generator.normal(size=2) * 0.1
        bearing = wrap_rad(predicted.bearing_rad + noisy[1])
        fold_in(
            belief(pose, covariance),
            predicted,
            NOISE._replace(range_m=predicted.range_m + noisy[0], bearing_rad=bearing),
        )
        assert np.isfinite(pose).all()
        assert np.linalg.eigvalsh(covariance).min() > -1e-9


@given(SEEDS, st.booleans())
def test_a_landmark_seen_again_comes_closer_with_a_smaller_covariance(seed: int, linear: bool) -> None:
    generator = np.random.default_rng(seed)
    pose, _, truth = scene(seed)
    sensor = sensor_pose(pose, MOUNT)
    landmark = np.empty(6)
    first = measured(pose, truth) + generator.normal(size=2) * (0.1, 0.02)
    new_landmark(landmark, sensor, NOISE._replace(range_m=first[0], bearing_rad=first[1]), WEIGHTS_2, SPREAD, linear)
    before = landmark[2] + landmark[4]
    for _ in range(30):
        z = measured(pose, truth) + generator.normal(size=2) * (0.1, 0.02)
        update_landmark(landmark, sensor, NOISE._replace(range_m=z[0], bearing_rad=z[1]), WEIGHTS_2, SPREAD, linear)
        assert landmark[2] * landmark[4] - landmark[3] ** 2 > 0.0
    assert landmark[2] + landmark[4] < before / 15
    assert np.hypot(*(landmark[:2] - truth[:2])) < 0.4


@given(SEEDS)
def test_a_new_landmark_is_the_inverse_of_the_measurement(seed: int) -> None:
    pose, _, truth = scene(seed)
    z = measured(pose, truth)
    sighting = NOISE._replace(range_m=float(z[0]), bearing_rad=float(z[1]))
    unscented, linear = np.empty(6), np.empty(6)
    new_landmark(unscented, sensor_pose(pose, MOUNT), sighting, WEIGHTS_2, SPREAD, False)
    new_landmark(linear, sensor_pose(pose, MOUNT), sighting, WEIGHTS_2, SPREAD, True)
    np.testing.assert_allclose(linear[:2], truth[:2], atol=1e-9)
    np.testing.assert_allclose(unscented[:5], linear[:5], atol=5e-3 * float(z[0]))


def test_another_features_noise_replaces_the_old_one() -> None:
    pose, covariance, landmark = scene(2)
    other = Sighting(1.0, 0.1, 0.5, 0.01, 0.02)
    swapped = with_noise(moments(pose, covariance, landmark), NOISE, other)
    np.testing.assert_allclose(swapped, moments(pose, covariance, landmark, other), atol=1e-12)
