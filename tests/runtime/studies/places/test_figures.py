import numpy as np
import pytest

from drivers.measurements import FloatArray, Scan, uniform_bearings
from runtime.evaluate.truth import DataSetTruth
from runtime.studies.places.at_rest import standing_points
from runtime.studies.places.drive import Driven
from runtime.studies.places.figures import occupied_cells, truth_figures
from slam.estimate import Quality

HERE = (0.0, 0.0, 0.0)


def line(ticks: int, turned_rad: float = 0.0) -> FloatArray:
    """Rows of t s, x m, y m, heading rad: a metre a second straight on."""
    t = np.arange(ticks, dtype=np.float64)
    return np.column_stack((t, t * np.cos(turned_rad), t * np.sin(turned_rad), np.full(ticks, turned_rad)))


def scan(stamp_s: float, ranges_m: list[float]) -> Scan:
    bearings = uniform_bearings(-0.5, 1.0 / (len(ranges_m) - 1), len(ranges_m))
    return Scan(round(stamp_s * 1e9), np.array(ranges_m, dtype=np.float32), bearings)


def test_errors_are_those_after_the_fit_and_a_quality_is_judged_at_every_tick() -> None:
    published = line(101, 0.4)
    published[80:, 2] += 6.0
    qualities = [Quality.TRACKING] * 101
    qualities[20:40] = [Quality.LOST] * 20
    sigma = np.full(101, 0.9)
    drive = Driven(published, line(101), sigma, np.ones(101), tuple(qualities), np.zeros(101), 3, 0)
    truth = DataSetTruth(poses=line(101)[::2], of_body=True)
    figures = truth_figures(drive, truth, (5.0, 0.0, 0.0))
    assert figures["odometry_rms_m"] == pytest.approx(0.0, abs=1e-9)
    assert 0.3 < figures["published_rms_m"] < 6.0
    assert figures["false_lost"] == pytest.approx(20 / 101)
    assert 0.0 < figures["false_tracking"] < 0.5
    assert "published_relation_m" not in figures


def false_tracking_of(published: FloatArray, sigma_m: FloatArray, maps: FloatArray) -> float:
    drive = Driven(published, line(101), sigma_m, maps, (Quality.TRACKING,) * 101, np.zeros(101), 3, 0)
    return float(truth_figures(drive, DataSetTruth(poses=line(101), of_body=True), HERE)["false_tracking"])


def test_a_drive_that_knows_how_far_it_strayed_was_not_wrong_where_it_knew_its_place() -> None:
    strayed, sigma_m = line(101), np.full(101, 0.1)
    strayed[30:90, 2] += 6.0
    assert false_tracking_of(strayed, sigma_m, np.ones(101)) > 0.4
    sigma_m[30:90] = 3.0
    assert false_tracking_of(strayed, sigma_m, np.ones(101)) == 0.0


def test_what_is_in_another_map_is_in_another_frame() -> None:
    published, maps = line(101), np.ones(101)
    published[40:60, 1:3] += (50.0, -20.0)
    assert false_tracking_of(published, np.ones(101), maps) > 0.1
    maps[40:60] = 2.0
    assert false_tracking_of(published, np.ones(101), maps) == 0.0


def test_relations_decide_over_the_odometry_where_the_set_has_them() -> None:
    published, odometry = line(11), line(11)
    odometry[:, 1] *= 1.2
    published[:, 1] *= 1.1
    drive = Driven(published, odometry, np.ones(11), np.ones(11), (Quality.TRACKING,) * 11, np.zeros(11), 0, 0)
    relations = np.array([[0.0, 10.0, 10.0, 0.0, 0.0], [2.25, 4.25, 2.0, 0.0, 0.0]])
    figures = truth_figures(drive, DataSetTruth(relations=relations), HERE)
    assert figures["published_relation_m"] == pytest.approx(0.5 * (1.0 + 0.2))
    assert figures["over_odometry"] == pytest.approx(0.5)


def test_a_wall_drawn_twice_from_a_wrong_pose_fills_more_cells() -> None:
    scans = [scan(0.0, [2.0] * 41), scan(1.0, [2.0] * 41), scan(1.0, [float("nan")] * 41)]
    still, off = np.zeros((2, 4)), np.zeros((2, 4))
    still[1, 0] = off[1, 0] = 1.0
    off[1, 1] = 0.4
    once = occupied_cells(scans[:1], still, HERE)
    assert occupied_cells(scans, still, HERE) == once
    assert occupied_cells(scans, off, HERE) > 1.5 * once


def test_what_stands_is_what_a_beam_returns_most_of_the_time() -> None:
    nothing = float("nan")
    scans = [scan(0.1 * k, [3.0, 3.0 if k % 3 else 1.0, 2.0 if k == 0 else nothing]) for k in range(12)]
    points = standing_points(scans)
    assert np.hypot(*points.T) == pytest.approx([3.0, 3.0])
