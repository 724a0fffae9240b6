from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.errors import UsageError
from runtime.evaluate.errors import position_error, rigid_fit
from runtime.smooth.contradictions import doubled, partings, wrong_matches
from runtime.smooth.solve import SmoothedDrive, smooth_drive
from slam.pose import composed
from tests.support.runtime.told_drive import CONFIGURED, SCANS, STEP_S, told_drive, true_path, with_identities


@pytest.fixture(scope="module")
def drive() -> SmoothedDrive:
    told, _ = told_drive()
    return smooth_drive(told)


def test_the_smoothed_path_is_nearer_to_the_truth_than_the_filters(drive: SmoothedDrive) -> None:
    told, posts = told_drive()
    truth = true_path()

    def rms_m(points_m: FloatArray, true_m: FloatArray) -> float:
        return position_error(rigid_fit(points_m, true_m).transform(points_m), true_m).rms_m

    assert rms_m(drive.solution.poses[:, :2], truth[:, :2]) < 0.6 * rms_m(told.filtered[:, :2], truth[:, :2])
    assert rms_m(drive.solution.landmarks, posts[drive.solution.identities]) < 0.05


def test_the_noise_is_found_where_the_configuration_forgives_too_much(drive: SmoothedDrive) -> None:
    assert drive.noise.ranges == pytest.approx(1.0 / CONFIGURED, rel=0.4)
    assert drive.noise.bearings == pytest.approx(1.0 / CONFIGURED, rel=0.4)


def test_covariances_of_the_path_hold_its_errors(drive: SmoothedDrive) -> None:
    told, _ = told_drive()
    covariances, truth = drive.solution.covariances(), true_path()
    squares = []
    for number in range(20, SCANS, 20):
        spread = covariances.pose(number, drive.solution.poses[number], told.body_from_laser)
        off = drive.solution.poses[number] - truth[number]
        off[2] = np.arctan2(np.sin(off[2]), np.cos(off[2]))
        squares.append(off @ np.linalg.solve(spread, off))
    assert 0.5 < np.mean(squares) < 8.0  # three on average


def test_the_same_drive_gives_the_same_bits(drive: SmoothedDrive) -> None:
    told, _ = told_drive()
    again = smooth_drive(told)
    assert again.solution.poses.tobytes() == drive.solution.poses.tobytes()
    assert again.squares.tobytes() == drive.squares.tobytes()


def test_a_right_drive_has_no_wrong_match(drive: SmoothedDrive) -> None:
    told, _ = told_drive()
    assert wrong_matches(told, drive) == []
    assert doubled(told, drive, drive.solution.covariances()) == []


def test_one_wrong_match_is_found_with_its_time_and_does_not_bend_the_path(drive: SmoothedDrive) -> None:
    told, posts = told_drive()
    at = int(np.flatnonzero(told.sightings.scans == 120)[0])
    was = int(told.sightings.identities[at])
    distances = np.hypot(*(posts - posts[was]).T)
    taken_for = int(np.argsort(distances)[1])
    identities = told.sightings.identities.copy()
    identities[at] = taken_for
    wrong = smooth_drive(with_identities(told, identities))
    (match,) = wrong_matches(told, wrong)
    assert match.landmark == taken_for
    assert match.sightings == 1
    assert match.start_s == pytest.approx(120 * STEP_S)
    assert match.off_m == pytest.approx(distances[taken_for], abs=0.3)
    assert np.abs(wrong.solution.poses - drive.solution.poses)[:, :2].max() < 0.05  # it has one sighting less


def test_a_landmark_that_was_mapped_twice_is_found() -> None:
    told, _ = told_drive()
    seen = told.sightings
    mine = int(np.bincount(seen.identities).argmax())
    identities = np.where((seen.identities == mine) & (seen.scans >= SCANS // 2), 1000, seen.identities)
    told = with_identities(told, identities)
    twice = smooth_drive(told)
    (pair,) = doubled(told, twice, twice.solution.covariances())
    assert {pair.first, pair.second} == {mine, 1000}
    made_anew = replace(told, final=told.final[told.final != mine])
    assert doubled(made_anew, twice, twice.solution.covariances()) == []


def test_a_filter_that_was_elsewhere_for_a_while_parts_from_the_path(drive: SmoothedDrive) -> None:
    told, _ = told_drive()
    filtered = told.filtered.copy()
    filtered[100:110] = composed(np.array((0.0, 1.0, 0.0)), filtered[100:110])
    poses, sampled, covariances = drive.solution.poses, np.arange(0, SCANS, 20), drive.solution.covariances()
    spreads = np.array([covariances.pose(number, poses[number], told.body_from_laser) for number in sampled.tolist()])
    found = partings(replace(told, filtered=filtered), poses, sampled, spreads)
    assert found[0].start_s == pytest.approx(100 * STEP_S)
    assert found[0].end_s == pytest.approx(109 * STEP_S)
    assert found[0].apart_m == pytest.approx(1.0, abs=0.3)
    assert partings(told, poses, sampled, spreads) == []


def test_a_run_without_landmarks_is_refused() -> None:
    told, _ = told_drive()
    with pytest.raises(UsageError, match="nothing to smooth its path by"):
        smooth_drive(replace(told, sightings=told.sightings.chosen(np.zeros(0, dtype=np.int64))))
