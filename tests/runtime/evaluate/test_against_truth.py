import math

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.evaluate.against_truth import compare_with_truth, fitted_error, path_error, relation_error
from runtime.evaluate.evaluate import against_data_set
from runtime.evaluate.rows import LONGEST_GAP_S, poses_at, relative_poses
from runtime.evaluate.truth import NO_OFFSET, DataSetTruth
from runtime.record.trajectories import Trajectories
from slam.pose import Pose2, composed

MOUNT = (2.0, 0.5, 0.0)


def bend(count: int = 60, spacing_s: float = 0.1) -> FloatArray:
    """Rows of t, x, y, heading: a drive round a bend at 1 m/s."""
    t = np.arange(count) * spacing_s
    heading = 0.4 * t
    return np.column_stack((t, np.cumsum(np.cos(heading)) * spacing_s, np.cumsum(np.sin(heading)) * spacing_s, heading))


def moved(trajectory: FloatArray, by: Pose2) -> FloatArray:
    """The same drive seen from another frame."""
    points = by.transform(trajectory[:, 1:3])
    return np.column_stack((trajectory[:, 0], points, trajectory[:, 3] + by.heading_rad))


def relations_of(path: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """True relations between two times each."""
    between = relative_poses(poses_at(path, first), poses_at(path, second))
    return np.column_stack((first, second, between))


def test_fixes_are_compared_at_the_laser_and_outliers_only_reach_the_full_figures() -> None:
    body = bend()
    laser = composed(body[:, 1:], np.array(MOUNT))
    fixes = moved(np.column_stack((body[:, 0], laser)), Pose2(100.0, 50.0, -2.0))[:, :3]
    exact, used = fitted_error(body, fixes, MOUNT)
    assert exact is not None
    assert exact.rms_m == pytest.approx(0.0, abs=1e-9)
    assert used == 60
    elsewhere, _ = fitted_error(body, fixes)
    assert elsewhere is not None
    assert elsewhere.rms_m > 0.1
    fixes[30, 1] += 40.0
    wild, _ = fitted_error(body, fixes, MOUNT)
    assert wild is not None
    assert wild.largest_m > 30.0
    assert wild.trimmed_rms_m < 0.2 * wild.rms_m


def test_every_relation_between_scans_of_a_slow_laser_is_used() -> None:
    fine = bend(600, 0.01)
    slow = fine[::25]  # 4 Hz
    first = np.linspace(0.0, 4.0, 50) + 0.087
    error, used = relation_error(slow, relations_of(fine, first, first + 1.5))
    assert error is not None
    assert used == 50
    assert error.translation_m < 0.01
    assert error.rotation_deg < 0.1


def test_relations_do_not_care_about_the_frame() -> None:
    body = bend()
    relations = relations_of(body, np.array([0.02, 1.0, 5.88]), np.array([4.98, 4.0, 0.3]))
    error, used = relation_error(moved(body, Pose2(5.0, 5.0, 2.0)), relations)
    assert error is not None
    assert used == 3
    assert error.translation_m == pytest.approx(0.0, abs=1e-9)
    relations[0, 2:] += (0.3, 0.4, math.radians(9.0))
    error, _ = relation_error(body, relations)
    assert error is not None
    assert error.translation_m == pytest.approx(0.5 / 3, rel=1e-6)
    assert error.rotation_deg == pytest.approx(3.0, rel=1e-6)


def test_relations_beyond_the_path_are_left_out_and_counted() -> None:
    relations = np.array([[0.0, 100.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0]])
    error = path_error(bend(), DataSetTruth(relations=relations))
    assert (error.relations_used, error.relations_known) == (1, 2)
    assert relation_error(bend(), relations[:1]) == (None, 0)


def test_places_beyond_the_path_are_not_extrapolated() -> None:
    fixes = np.array([[100.0, 0.0, 0.0], [101.0, 1.0, 0.0], [102.0, 2.0, 0.0]])
    assert fitted_error(bend(), fixes) == (None, 0)


def test_nothing_is_interpolated_where_a_part_of_the_record_is_gone() -> None:
    path = bend()
    path[30:, 0] += LONGEST_GAP_S + 1.0
    inside = np.isfinite(poses_at(path, np.array([path[0, 0], path[29, 0], path[29, 0] + 5.0, path[30, 0]]))[:, 0])
    assert inside.tolist() == [True, True, False, True]


def test_a_truth_of_the_body_and_one_of_its_laser_agree() -> None:
    body = bend()
    laser = np.column_stack((body[:, 0], composed(body[:, 1:], np.array(MOUNT))))
    for truth in (DataSetTruth(poses=laser), DataSetTruth(poses=body, of_body=True)):
        error = path_error(body, truth, MOUNT).position
        assert error is not None
        assert error.rms_m == pytest.approx(0.0, abs=1e-9)
        places = truth.places_of_body(MOUNT)
        assert places is not None
        np.testing.assert_allclose(places[:, :3], body[:, :3], atol=1e-9)
        assert DataSetTruth.from_attachments({"truth.npz": truth.attachment()}).of_body == truth.of_body  # type: ignore[union-attr]


def test_the_published_path_is_weighed_against_odometry_by_relations_where_there_are_any() -> None:
    body = bend()
    drifting = body + np.column_stack((np.zeros(60), 0.1 * body[:, 0], np.zeros((60, 2))))
    better = body + np.column_stack((np.zeros(60), 0.01 * body[:, 0], np.zeros((60, 2))))
    relations = relations_of(body, np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.5, 1.5, 2.5, 3.5]))
    by_relations = compare_with_truth(better, drifting, DataSetTruth(relations=relations, poses=body))
    assert by_relations.over_odometry == pytest.approx(0.1, rel=0.01)
    by_position = compare_with_truth(body, drifting, DataSetTruth(poses=body))
    assert by_position.over_odometry == pytest.approx(0.0, abs=1e-6)
    assert compare_with_truth(body, drifting, DataSetTruth()).over_odometry is None


def test_relations_and_poses_of_a_data_set_are_those_of_its_laser() -> None:
    body = np.array([(float(t), 0.0, 0.0, 0.5 * t) for t in range(7)])  # turns on the spot
    laser = np.column_stack((body[:, 0], composed(body[:, 1:], np.array((0.3, 0.0, 0.0)))))
    truth = DataSetTruth(poses=laser, relations=relations_of(laser, laser[:-1, 0], laser[1:, 0]))
    ahead = against_data_set(Trajectories(body, body, body, None), truth, (0.3, 0.0, 0.0))
    assert ahead["relation_translation_m"] == pytest.approx(0.0, abs=1e-9)
    assert ahead["rms_m"] == pytest.approx(0.0, abs=1e-9)
    middle = against_data_set(Trajectories(body, body, body, None), truth, NO_OFFSET)
    assert middle["relation_translation_m"] > 0.1
    assert middle["rms_m"] > 0.1
