import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.measurements import FloatArray
from slam.joint import gaussian, state
from slam.joint.gaussian import JointGaussian, Variant
from slam.observations import FeatureRows, Features, MatchVerdict, Sighting, usable_rows
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from slam.visibility import SightLine
from tests.support.examples import examples

STILL = (np.zeros(3), np.zeros((3, 3)))
STEP_NOISE = np.diag((0.02**2, 0.005**2, 0.01**2))
NOISE = np.diag((0.1**2, math.radians(1.0) ** 2))
AHEAD = np.array((0.4, 0.0, 0.0))
TUNING = SlamSettings().tuning()
OPEN = SightLine(-2.0, 4.0 / 400, 30.0, np.full(401, np.nan))
RING = [(12.0, 1.0), (6.0, -9.0), (3.0, 8.0), (-4.0, 7.0), (15.0, -12.0), (-2.0, -6.0)]


def features_at(
    points: list[tuple[float, float]],
    identities: list[int] | None = None,
    licence: bool = True,
    noise: FloatArray | None = None,
) -> FeatureRows:
    """Features of points in the laser's frame; noise (K, 2) on range and bearing."""
    array = np.array(points, dtype=np.float64).reshape(-1, 2)
    count = len(array)
    noise = np.zeros((count, 2)) if noise is None else noise
    features = Features(
        0,
        np.hypot(array[:, 0], array[:, 1]) + noise[:, 0],
        np.arctan2(array[:, 1], array[:, 0]) + noise[:, 1],
        np.tile(NOISE, (count, 1, 1)),
        np.full(count, licence),
        np.full(count, -1, dtype=np.int64) if identities is None else np.array(identities, dtype=np.int64),
        np.full(count, -1, dtype=np.int64),
    )
    return usable_rows(features, TUNING.range_max_m, 0.0)


def unknown(features: FeatureRows) -> NDArray[np.int64]:
    return np.full(features.ranges_m.size, -1, dtype=np.int64)


def seen_from(pose: Pose2, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    local = pose.inverse().transform(np.array(points))
    return [(float(x), float(y)) for x, y in local]


def look(joint: JointGaussian, points: list[tuple[float, float]], times: int = 1) -> NDArray[np.int64]:
    """Stand still and see points of the laser's frame."""
    for _ in range(times):
        seen = features_at(points)
        verdicts = joint.step(*STILL, seen, unknown(seen))
    return verdicts


def test_a_landmark_seen_twice_is_one_landmark() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    assert (look(joint, RING) == int(MatchVerdict.NEW)).all()
    assert (look(joint, RING) >= 0).all()
    assert joint.landmark_count == len(RING)


def test_the_mount_places_landmarks_where_the_laser_sees_them() -> None:
    mount = Pose2(3.0, 0.5, 0.3)
    joint = JointGaussian(JointSettings(), mount, TUNING)
    look(joint, RING)
    assert np.allclose(joint.landmarks().means_m, mount.transform(np.array(RING)))


def test_a_second_feature_beside_a_landmark_neither_matches_nor_creates() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, [(10.0, 0.0)], 3)
    verdicts = look(joint, [(10.25, 0.0), (10.0, 0.0)])
    assert verdicts[1] >= 0
    assert verdicts[0] == int(MatchVerdict.EXCLUDED)
    assert joint.landmark_count == 1


def test_a_feature_without_licence_creates_at_rest_only() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    seen = features_at(RING[:1], licence=False)
    assert joint.step(AHEAD, STEP_NOISE, seen, unknown(seen))[0] == int(MatchVerdict.UNLICENSED)
    assert joint.step(*STILL, seen, unknown(seen))[0] == int(MatchVerdict.NEW)


def test_what_should_be_seen_and_is_not_is_removed() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, [*RING, (8.0, 0.0)])
    look(joint, RING, 4)
    assert joint.landmark_count == len(RING)


@pytest.mark.parametrize("told_apart", [False, True])
def test_two_landmarks_in_one_place_are_one_unless_they_tell_who_they_are(told_apart: bool) -> None:
    """They came to stand there when the pose was corrected; each would be missed whenever the other is found."""
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    features = features_at(RING, list(range(len(RING))) if told_apart else None)
    joint.step(*STILL, features, unknown(features))
    assert joint.landmark_count == len(RING)
    identities = joint.landmarks().identities
    x_m, y_m = RING[0]
    sighting = Sighting(math.hypot(x_m + 0.05, y_m), math.atan2(y_m, x_m + 0.05), 0.01, 0.0, 0.0003)
    joint.state.create(int(identities.max()) + 1, 3.0, np.zeros(3), sighting)
    joint.step(*STILL, features, unknown(features))
    assert joint.landmark_count == len(RING) + told_apart
    assert set(identities.tolist()) <= set(joint.landmarks().identities.tolist())


def test_what_was_seen_once_is_forgotten_when_it_leaves_the_view() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, [(-20.0, 0.0)])
    look(joint, [(-21.0, 8.0)], 5)
    away = features_at([])
    joint.step(np.array((30.0, 0.0, 0.0)), STEP_NOISE, away, unknown(away))
    kept = joint.landmarks()
    assert kept.means_m.shape == (1, 2)
    assert np.allclose(kept.means_m[0], (-21.0, 8.0), atol=1e-6)


def test_identities_of_the_sensor_decide_where_it_has_them() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    first = features_at([(10.0, 0.0), (10.0, 0.8)], [7, 9])
    joint.step(*STILL, first, unknown(first))
    swapped = features_at([(10.0, 0.3), (10.0, 0.5)], [9, 7])
    assert joint.step(*STILL, swapped, unknown(swapped)).tolist() == [9, 7]
    misread = features_at([(3.0, 9.0)], [7])
    assert joint.step(*STILL, misread, unknown(misread))[0] == int(MatchVerdict.AMBIGUOUS)
    assert sorted(joint.landmarks().identities.tolist()) == [7, 9]


def test_matches_of_the_particles_are_followed_only_if_told_to_and_inside_the_gate() -> None:
    told, seen = np.array((11, 12)), features_at([(10.0, 0.0), (10.0, 0.9)])
    follower = JointGaussian(JointSettings(), Pose2(), TUNING, Variant(association="particles"))
    follower.step(*STILL, seen, told)
    assert follower.step(*STILL, features_at([(10.0, 0.4), (10.0, 0.5)]), told[::-1]).tolist() == [12, 11]
    assert follower.step(*STILL, features_at([(3.0, 5.0)]), told[:1])[0] == int(MatchVerdict.AMBIGUOUS)
    alone = JointGaussian(JointSettings(), Pose2(), TUNING)
    alone.step(*STILL, seen, told)
    assert alone.step(*STILL, seen, told[::-1]).tolist() == [0, 1]


def test_a_landmark_has_the_identity_of_its_scan_and_feature() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, [(10.0, 0.0)])
    look(joint, [(10.0, 0.0), (0.0, 10.0)])
    assert joint.landmarks().identities.tolist() == [0, 4097]


@pytest.mark.parametrize("part", [0, 1])
def test_an_increment_with_nan_is_refused_and_leaves_no_trace(part: int) -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, RING, 2)
    increment = [AHEAD.copy(), STEP_NOISE.copy()]
    increment[part].flat[0] = math.nan
    seen = features_at(RING)
    joint.step(increment[0], increment[1], seen, unknown(seen))
    assert joint.refused == 1
    assert np.isfinite(joint.covariance).all()
    assert joint.map_from_body.x_m == pytest.approx(0.0, abs=1e-6)
    before = joint.state.atlas.looks.sum()
    joint.step(AHEAD, STEP_NOISE, seen, unknown(seen), OPEN)
    assert joint.state.atlas.looks.sum() > before, "it goes on to learn what is found"


def test_standing_still_the_pose_stays_exact_and_landmarks_sharpen() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING._replace(lasting=(0.0, 0.0)))
    look(joint, RING)
    first = joint.landmarks().covariances_m2.copy()
    look(joint, RING, 9)
    assert np.allclose(joint.landmarks().covariances_m2, first / 10.0, rtol=1e-6)
    assert np.diag(joint.covariance).max() <= 1.0001e-12


@pytest.mark.parametrize(
    ("step_m", "lasting", "least", "most"), [(0.05, 1, 0.06, 0.12), (1.0, 1, 0.0, 0.04), (0.05, 0, 0.0, 0.04)]
)
def test_many_looks_from_nearly_the_same_place_tell_as_much_as_one(
    step_m: float, lasting: int, least: float, most: float
) -> None:
    """A corner is off by the same 10 cm from scan to scan, and by other 10 cm from a metre further on."""
    tuning = TUNING._replace(lasting=(0.1 * lasting, math.radians(1.0) * lasting))
    joint = JointGaussian(JointSettings(), Pose2(), tuning)
    seen = features_at([(0.0, 5.0)])
    for number in range(20):
        at = Pose2(number * step_m, 0.0, 0.0)
        seen = features_at(seen_from(at, [(0.0, 5.0)]))
        joint.predict(np.array((step_m if number else 0.0, 0.0, 0.0)), np.zeros((3, 3)))
        joint.observe(seen, unknown(seen), begins=number == 0)
    assert joint.landmark_count == 1
    sigma_m = math.sqrt(joint.landmarks().covariances_m2[0].trace() / 2.0)
    assert least <= sigma_m <= most


def heading_deviation(jacobians: Literal["invariant", "first_estimates", "current"]) -> float:
    """Of a rover that never knew its heading better than 0.1 rad, after 40 noisy scans of the same six landmarks."""
    generator = np.random.default_rng(5)
    joint = JointGaussian(JointSettings(), Pose2(), TUNING, Variant(jacobians=jacobians))
    joint.step(np.array((0.0, 0.0, 0.0)), np.diag((1e-12, 1e-12, 0.1**2)), features_at([]), np.empty(0, dtype=np.int64))
    truth, noise = Pose2(), np.diag((0.1**2, 0.05**2, 0.05**2))
    for _ in range(40):
        increment = np.array((0.3, 0.0, 0.1))
        truth = truth @ Pose2(*increment.tolist())
        noise_z = [generator.standard_normal(len(RING)) for _ in range(2)]
        seen = features_at(seen_from(truth, RING), noise=np.column_stack((0.1 * noise_z[0], 0.0175 * noise_z[1])))
        wheels = increment + np.sqrt(np.diag(noise)) * generator.standard_normal(3)
        joint.step(wheels, noise, seen, unknown(seen))
    return math.sqrt(float(joint.covariance[2, 2]))


def test_turning_the_whole_map_is_never_observed() -> None:
    assert heading_deviation("invariant") >= 0.0999
    assert heading_deviation("first_estimates") >= 0.0999
    assert heading_deviation("current") < 0.0999


def test_constants_of_the_odometry_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state, "DISTANCE_SCALE_SIGMA", 0.05)
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    posts = [(x, y) for x in np.arange(0.0, 200.0, 9.0).tolist() for y in (-7.0, 8.0)]
    truth = Pose2()
    look(joint, [point for point in posts if point[0] < 25.0], 5)
    for _ in range(400):
        truth = truth @ Pose2(*AHEAD.tolist())
        local = [point for point in seen_from(truth, posts) if math.hypot(*point) < 25.0]
        seen = features_at(local)
        joint.step(AHEAD * np.array((0.97, 1.0, 1.0)), STEP_NOISE, seen, unknown(seen))
    distance_scale = np.frombuffer(joint.state_bytes(), count=4)[3]  # the state begins with pose and constants
    assert distance_scale == pytest.approx(1.0 / 0.97 - 1.0, abs=0.005)
    assert joint.map_from_body.x_m == pytest.approx(truth.x_m, abs=0.5)


coordinates = st.floats(-25.0, 25.0)
scans = st.lists(
    st.tuples(
        st.floats(-1.0, 1.0),
        st.floats(-1.5, 1.5),
        st.floats(1e-9, 1.0),
        st.lists(st.tuples(coordinates, coordinates), max_size=6),
    ),
    min_size=1,
    max_size=12,
)


@examples(60)
@given(scans=scans)
def test_the_covariance_stays_symmetric_and_positive_whatever_is_seen(
    scans: list[tuple[float, float, float, list[tuple[float, float]]]],
) -> None:
    joint = JointGaussian(JointSettings(landmarks_in_state=8), Pose2(), TUNING)
    for forward, turn, deviation, points in scans:
        seen = features_at([point for point in points if math.hypot(*point) > 0.01])
        joint.step(np.array((forward, 0.0, turn)), np.eye(3) * deviation**2, seen, unknown(seen))
        covariance = joint.covariance
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
        kept = joint.landmarks().covariances_m2
        assert np.array_equal(kept, kept.transpose(0, 2, 1))
        assert (np.linalg.eigvalsh(kept) > 0.0).all()
        assert np.isfinite(joint.map_from_body.as_array()).all()


def test_the_same_steps_give_the_same_bytes_and_every_step_changes_them() -> None:
    states: list[list[bytes]] = []
    for _ in range(2):
        joint = JointGaussian(JointSettings(), Pose2(), TUNING)
        states.append([])
        for index in range(5):
            seen = features_at(RING[: index + 1])
            joint.step(AHEAD, STEP_NOISE, seen, unknown(seen))
            states[-1].append(joint.state_bytes())
    assert states[0] == states[1]
    assert len(set(states[0])) == 5


def test_a_jump_of_half_a_turn_in_heading_stays_wrapped() -> None:
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    for _ in range(10):
        joint.step(np.array((0.0, 0.0, 1.0)), STEP_NOISE, features_at([]), np.empty(0, dtype=np.int64))
    assert -math.pi < joint.map_from_body.heading_rad <= math.pi


def test_no_more_landmarks_are_made_than_the_state_may_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gaussian, "MOST_IN_STATE", 4)
    joint = JointGaussian(JointSettings(), Pose2(), TUNING)
    look(joint, RING, 2)
    assert joint.landmark_count == 4
