import numpy as np
import pytest

from drivers.measurements import FloatArray, Scan, Sightings, uniform_bearings
from runtime.evaluate.truth import DataSetTruth
from runtime.studies.paper.drives.recorded_drive import is_there, recorded_drive, thinned, without_identities
from runtime.studies.paper.drives.recorded_errors import figures_against


def sightings(count: int) -> Sightings:
    return Sightings(0, np.full(count, 2.0), np.zeros(count), np.arange(count))


def test_a_share_of_sightings_or_of_scans_is_left_out_and_a_seed_leaves_out_the_same() -> None:
    scan = Scan(0, np.ones(3, dtype=np.float32), uniform_bearings(0.0, 0.1, 3))
    left = next(iter(thinned([sightings(4000)], 0.25, np.random.default_rng(1))))
    assert 0.7 < len(left.ranges_m) / 4000 < 0.8
    again = next(iter(thinned([sightings(4000)], 0.25, np.random.default_rng(1))))
    assert np.array_equal(left.identities, again.identities)  # type: ignore[union-attr]
    assert 0.7 < len(list(thinned([scan] * 4000, 0.25, np.random.default_rng(2)))) / 4000 < 0.8
    assert list(thinned([scan], 0.0, np.random.default_rng(3))) == [scan]


def test_withheld_identities_are_gone_and_the_rest_stays() -> None:
    (anonymous,) = without_identities([sightings(3)])
    assert isinstance(anonymous, Sightings)
    assert anonymous.identities.tolist() == [-1, -1, -1]
    assert anonymous.ranges_m.tolist() == [2.0, 2.0, 2.0]


def drive_round(offset_rad: float) -> FloatArray:
    """Rows of t, x, y, heading on a circle of 10 m, in a map that is turned by offset_rad."""
    t = np.linspace(0.0, 30.0, 300)
    angle = 0.2 * t
    x, y = 10.0 * np.sin(angle), 10.0 * (1.0 - np.cos(angle))
    cosine, sine = np.cos(offset_rad), np.sin(offset_rad)
    return np.column_stack((t, cosine * x - sine * y, sine * x + cosine * y, angle + offset_rad))


def test_errors_do_not_depend_on_the_frame_of_the_truth_and_nees_is_that_of_the_pose() -> None:
    truth = DataSetTruth(poses=drive_round(0.0))
    path = drive_round(0.7)
    path[150:, 1] += 0.3 * np.cos(0.7)
    path[150:, 2] += 0.3 * np.sin(0.7)
    paths = {"published": path, "odometry": drive_round(0.2)}
    figures = figures_against(truth, paths, np.tile(np.eye(3) * 0.01, (300, 1, 1)), (0.0, 0.0, 0.0))
    assert figures["odometry_aligned_rms_m"] == pytest.approx(0.0, abs=1e-6)
    assert figures["published_largest_m"] == pytest.approx(0.3, abs=1e-6)
    assert figures["published_aligned_rms_m"] < 0.2
    assert figures["nees_median"] == pytest.approx(0.5 * 0.3**2 / 0.01, abs=1e-3)


@pytest.mark.skipif(not is_there("mrclam_d6_r2"), reason="needs ../shared/data/mrclam_d6_r2")
def test_a_camera_that_does_not_tell_its_landmarks_apart_is_good_to_half_a_metre() -> None:
    figures = recorded_drive("mrclam_d6_r2", 0, "proposed", 2, False, "test", withheld=True)
    assert figures["published_aligned_rms_m"] < 0.50
    assert figures["not_finite"] == 0
    assert 1.0 < figures["nees_median"] < 12.0
