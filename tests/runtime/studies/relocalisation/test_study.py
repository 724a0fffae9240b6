from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import UsageError
from runtime.studies.paper.drives.worlds import feature_world
from runtime.studies.relocalisation import study
from runtime.studies.relocalisation.localisation import compared
from runtime.studies.relocalisation.slips import against_fixes, drawn_slip
from slam.pose import Pose2
from tests.support.runtime.small_maps import small_map


def test_a_rover_is_found_in_the_map_of_another_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "PLACES_A_WORLD", 3)
    monkeypatch.setattr(study, "WORLDS", (("P", 0.0),))
    result = study.run_relocalisation(("worlds", "localise"), 1, tmp_path, tmp_path, None, lambda done, total: None)
    (row,) = result["worlds"]
    assert (row["kidnaps"], row["recognised"], row["within 20 m"], row["wrong by 5 m"]) == (3, 3, 3, 0)
    assert row["error 50 %, m"] < 0.5
    localised = result["localise"][0]
    assert localised["rms_m"] < 0.4
    assert localised["map_moved_m"] == 0.0
    assert "| P |" in (tmp_path / "relocalisation.md").read_text()
    with pytest.raises(UsageError, match="expected worlds"):
        study.run_relocalisation(("nowhere",), 1, tmp_path, tmp_path, None, lambda done, total: None)


def test_a_landmark_that_is_gone_is_counted_and_says_nothing_of_the_others() -> None:
    known = small_map(12)
    after = replace(known, identities=np.append(known.identities[:-1], 7))
    assert compared(known, after) == {"moved_m": 0.0, "gone": 1}
    assert compared(known, replace(after, means_m=after.means_m + 0.25))["moved_m"] == pytest.approx(0.25)


def test_another_day_has_other_noise_and_as_many_landmarks_exchanged_as_asked_for() -> None:
    first, again, changed = (
        feature_world("P", 3, drive=day, exchanged=share) for day, share in ((0, 0), (1, 0), (1, 0.3))
    )
    np.testing.assert_array_equal(first.landmarks_m, again.landmarks_m)
    assert not np.array_equal(first.steps[5].sightings.ranges_m[:4], again.steps[5].sightings.ranges_m[:4])
    kept = (changed.landmarks_m[:, None] == first.landmarks_m).all(axis=2).any(axis=1).sum()
    assert kept == round(0.7 * len(first.landmarks_m)) == len(changed.landmarks_m) - 60


def test_errors_against_fixes_are_those_of_the_laser_after_a_rigid_fit() -> None:
    times = np.arange(50.0)
    way = np.column_stack((times, 5.0 * np.sin(0.1 * times), np.arctan(0.5 * np.cos(0.1 * times))))
    path = np.column_stack((times, way))
    laser = Pose2(1.0, 0.0, 0.0)
    points = way[:, :2] + np.column_stack((np.cos(way[:, 2]), np.sin(way[:, 2])))
    fixes = np.column_stack((times, Pose2(40.0, -3.0, 2.0).transform(points)))
    covariances = np.tile(np.diag((1.0, 0.01)), (50, 1, 1))
    exact = against_fixes(path, covariances, fixes, laser, slice(10, 10))
    assert exact["trimmed_m"] < 1e-6
    assert exact["after_m"] < 1e-6
    fixes[20, 1:] += 30.0
    assert against_fixes(path, covariances, fixes, laser, slice(50, None))["after_m"] is None
    assert against_fixes(path, covariances, fixes, Pose2(), slice(10, 10))["trimmed_m"] > exact["trimmed_m"]


def test_a_stretch_at_a_wrong_pose_turns_no_other_part_of_the_path() -> None:
    times = np.arange(50.0)
    path = np.column_stack((times, times, 0.1 * times**2, np.zeros(50)))
    fixes, covariances = path[:, :3].copy(), np.tile(np.eye(2), (50, 1, 1))
    path[20:30, 1:3] += 70.0
    figures = against_fixes(path, covariances, fixes, Pose2(), slice(20, 30))
    assert figures["after_m"] < 1e-6
    assert figures["nees_median"] < 1e-6
    assert figures["trimmed_m"] > 10.0


def test_slips_are_drawn_from_their_seed() -> None:
    at, slip = drawn_slip(4, 1000)
    assert (at, slip) == drawn_slip(4, 1000)
    assert 150 <= at <= 880
    assert 5.0 <= np.hypot(slip.x_m, slip.y_m) <= 80.0
    assert drawn_slip(None, 1000) == (1000, Pose2())
