import math

import numpy as np
import pytest

from runtime.studies.paper.drives.worlds import (
    BEARING_NOISE_RAD,
    DETECTION,
    OFF_PATH_M,
    PERIOD_S,
    RANGE_NOISE_M,
    SPEED_MPS,
    VIEW_M,
    VIEW_RAD,
    FeatureDrive,
    WorldKind,
    feature_world,
    path_length_m,
    path_poses,
)
from slam.pose import wrap_rads

KINDS: tuple[WorldKind, ...] = ("P", "V2", "LONELY")


@pytest.fixture(scope="module", params=KINDS)
def drive(request: pytest.FixtureRequest) -> FeatureDrive:
    return feature_world(request.param, 3)


def test_a_seed_gives_the_same_drive_and_another_seed_another() -> None:
    first, again, other = feature_world("V2", 1), feature_world("V2", 1), feature_world("V2", 2)
    for step, repeated in zip(first.steps, again.steps, strict=True):
        assert np.array_equal(step.sightings.ranges_m, repeated.sightings.ranges_m)
    assert [step.wheels for step in first.steps] == [step.wheels for step in again.steps]
    assert not np.array_equal(first.landmarks_m, other.landmarks_m)


def test_one_lap_is_374_m_and_closes() -> None:
    assert path_length_m() == pytest.approx(374.25, abs=0.01)
    poses = path_poses(np.array([0.0, path_length_m()]))
    assert np.allclose(poses[0], poses[1])


def test_the_heading_is_the_direction_of_travel() -> None:
    poses = path_poses(np.arange(0.0, path_length_m(), 0.01))
    ahead = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * wrap_rads(np.diff(poses[:, 2]))
    assert np.allclose(np.hypot(*ahead.T), 0.01, rtol=1e-3)
    assert np.abs(wrap_rads(np.arctan2(ahead[:, 1], ahead[:, 0]) - middle)).max() < 1e-3


def test_every_true_sighting_lies_within_noise_of_its_landmark(drive: FeatureDrive) -> None:
    ranges, bearings = [], []
    for step in drive.steps:
        true = step.landmark_of_sighting >= 0
        offsets = drive.landmarks_m[step.landmark_of_sighting[true]] - step.truth.as_array()[:2]
        ranges.append(step.sightings.ranges_m[true] - np.hypot(*offsets.T))
        angle = np.arctan2(offsets[:, 1], offsets[:, 0]) - step.truth.heading_rad
        bearings.append(wrap_rads(step.sightings.bearings_rad[true] - angle))
    count = sum(map(len, ranges))
    assert np.concatenate(ranges).std() == pytest.approx(RANGE_NOISE_M, rel=4.0 / math.sqrt(count))
    assert np.concatenate(bearings).std() == pytest.approx(BEARING_NOISE_RAD, rel=4.0 / math.sqrt(count))


def test_nine_of_ten_landmarks_in_view_are_seen_and_each_at_most_once_a_scan(drive: FeatureDrive) -> None:
    possible = seen = 0
    for step in drive.steps:
        offsets = drive.landmarks_m - step.truth.as_array()[:2]
        angle = wrap_rads(np.arctan2(offsets[:, 1], offsets[:, 0]) - step.truth.heading_rad)
        in_view = (np.hypot(*offsets.T) <= VIEW_M) & (np.abs(angle) <= VIEW_RAD)
        assert drive.ever_in_view[in_view].all()
        identities = step.landmark_of_sighting[step.landmark_of_sighting >= 0]
        assert len(set(identities.tolist())) == len(identities)
        assert in_view[identities].all()
        possible, seen = possible + int(in_view.sum()), seen + len(identities)
    assert seen / possible == pytest.approx(DETECTION, abs=4.0 * math.sqrt(0.09 / possible))


def test_sensors_do_not_say_what_they_saw(drive: FeatureDrive) -> None:
    assert all((step.sightings.identities == -1).all() for step in drive.steps)


def test_wheels_say_exactly_zero_at_rest_and_are_noisy_afterwards(drive: FeatureDrive) -> None:
    resting, driving = drive.steps[:10], drive.steps[10:]
    assert all(step.wheels[0].speed_mps == 0.0 and step.wheels[0].yaw_rate_radps == 0.0 for step in resting)
    speeds = np.array([step.wheels[0].speed_mps for step in driving])
    assert speeds.mean() == pytest.approx(SPEED_MPS, abs=0.03)
    assert speeds.std() == pytest.approx(0.2, rel=0.1)
    assert all(step.wheels[0].stamp_ns < step.stamp_ns for step in drive.steps)


def test_landmarks_keep_their_distance_from_each_other_and_the_path() -> None:
    drive = feature_world("P", 0)
    gaps = np.hypot(*(drive.landmarks_m[:, np.newaxis] - drive.landmarks_m[np.newaxis]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(gaps), dtype=bool)].min() > 2.0
    to_path = drive.landmarks_m[:, np.newaxis] - drive.truth[np.newaxis, :, :2]
    assert np.hypot(to_path[..., 0], to_path[..., 1]).min() > OFF_PATH_M - 0.03


def test_people_make_v2_harder_than_p() -> None:
    false = {
        kind: np.mean([(step.landmark_of_sighting < 0).sum() for step in feature_world(kind, 0).steps])
        for kind in KINDS
    }
    assert 0.1 < false["P"] < 0.8
    assert false["V2"] > 2.0
    assert false["LONELY"] == 0.0


def test_the_lonely_world_shows_about_one_landmark_at_a_time() -> None:
    counts = np.array([len(step.sightings.ranges_m) for step in feature_world("LONELY", 0).steps])
    assert counts.max() <= 2
    assert (counts == 1).mean() > 0.4
    assert (counts == 0).any()


def test_a_drive_without_a_scan_at_rest_is_refused() -> None:
    with pytest.raises(ValueError, match="scans_at_rest is 0"):
        feature_world("P", 0, scans_at_rest=0)


def test_a_scan_follows_the_other_at_the_period_of_the_world(drive: FeatureDrive) -> None:
    stamps = np.array([step.stamp_ns for step in drive.steps])
    assert (np.diff(stamps) == round(PERIOD_S * 1e9)).all()
