"""What a review computes for itself: innovation, the laser's clock, and a data set's truth laid onto the map."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.scip.codec import encode_time
from runtime.evaluate.truth import ATTACHMENT, DataSetTruth
from runtime.messages.records import tick_records
from runtime.messages.tick import LaserBytes, Record, encode_laser_bytes
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.review.clock_offset import LaserClockOffset
from runtime.review.innovation import beside_each_other, innovations, predicted_motion
from runtime.review.rebuild import build_review
from runtime.review.ticks import Motion
from runtime.review.truth import truth_track
from runtime.review.viewer import review_paths
from runtime.settings.configuration import load_configuration_text
from runtime.tick import CompletedTick, Tick
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import Features
from slam.pose import Pose2
from tests.runtime.evaluate.test_evaluate import CONFIGURATION, moved, path
from tests.runtime.review.test_rebuild import Drawn
from tests.support.runtime.recorded_values import make_timing

MOUNT = Pose2(0.3, 0.0, 0.0)
COVARIANCE = np.eye(3)


def estimate_at(stamp_ns: int, pose: Pose2, odometry: Pose2) -> Estimate:
    return Estimate(stamp_ns, pose, COVARIANCE, pose, COVARIANCE, odometry, Quality.TRACKING)


def seen_from(laser: Pose2, places_m: NDArray[np.float64], stamp_ns: int, yaw_rad: float) -> Features:
    """Perfect sightings by a laser that is turned by yaw_rad more than its mount says."""
    offsets_m = laser.inverse().transform(places_m)
    count = len(places_m)
    return Features(
        stamp_ns,
        np.hypot(offsets_m[:, 0], offsets_m[:, 1]),
        np.arctan2(offsets_m[:, 1], offsets_m[:, 0]) - yaw_rad,
        np.tile(np.eye(2), (count, 1, 1)),
        np.ones(count, np.bool_),
        np.full(count, -1),
        np.arange(count),
    )


@pytest.mark.parametrize("yaw_deg", [0.0, 1.5])
def test_innovation_is_zero_for_a_perfect_rover_and_the_yaw_of_a_laser_that_is_turned(yaw_deg: float) -> None:
    before, now = Pose2(1.0, 2.0, 0.4), Pose2(1.2, 2.1, 0.5)
    first = estimate_at(0, before, Pose2(7.0, 0.0, 1.0))
    second = estimate_at(100_000_000, now, Pose2(7.0, 0.0, 1.0) @ before.inverse() @ now)
    places_m = np.array(((9.0, 3.0), (4.0, -6.0), (-3.0, 8.0)))
    landmarks = LandmarkMap(np.array([5, 6, 7]), places_m, np.tile(np.eye(2), (3, 1, 1)), np.ones(3))
    features = seen_from(now @ MOUNT, places_m, second.stamp_ns, math.radians(yaw_deg))
    predicted = predicted_motion(first, second, Motion.between(first, second))
    matches = np.array([5, -1, 7])
    range_error_m, bearing_error_rad = innovations(features, matches, landmarks, predicted, MOUNT)
    np.testing.assert_allclose(range_error_m, np.zeros(2), atol=1e-12)
    np.testing.assert_allclose(np.degrees(bearing_error_rad), np.full(2, -yaw_deg), atol=1e-9)


def scan_bytes(stamp_ns: int, counter_ms: int) -> Record:
    data = b"MD0000108001000\n99b\n" + encode_time(counter_ms) + b"\n"
    return encode_laser_bytes(LaserBytes(stamp_ns, False, data))


@pytest.mark.parametrize("start_ms", [1000, (1 << 24) - 10_000], ids=["young", "before its wrap"])
def test_a_clock_that_runs_100_ppm_slow_climbs_a_millisecond_in_ten_seconds(start_ms: int) -> None:
    clock, rng = LaserClockOffset(), np.random.default_rng(2)
    seconds, drawn = [], []
    for k in range(3000):
        counter_ms = start_ms + round(k * 25 * (1 - 100e-6))
        arrival_ns = round((k * 25 + 4.0 + rng.exponential(2.0)) * 1e6)
        offset_ms = clock.feed(scan_bytes(arrival_ns, counter_ms % (1 << 24)))
        if offset_ms is not None:
            seconds.append(arrival_ns * 1e-9)
            drawn.append(offset_ms)
    assert 70 <= len(drawn) <= 76
    slope_ms_per_s = np.polyfit(seconds, drawn, 1)[0]
    assert slope_ms_per_s == pytest.approx(0.1, rel=0.1)


def write_imported_run(folder: Path, world_from_map: Pose2, offset_m: float) -> None:
    """A replayed import whose GPS stands beside the laser, in a frame of its own; every tenth fix is off."""
    folder.mkdir(parents=True)
    rows = path()
    mount = CONFIGURATION.slam.mount
    antenna = np.array([(Pose2(*row[1:]) @ Pose2(mount.x_m, mount.y_m, 0.0)).as_array() for row in rows.tolist()])
    antenna[::10, 1] += offset_m
    fixes = moved(np.column_stack((rows[:, 0], antenna)), world_from_map)[:, :3]
    truth = DataSetTruth(fixes, landmarks=np.array([[3.0, *world_from_map.transform(np.array([[5.0, 6.0]]))[0]]]))
    header = RunHeader(CONFIGURATION.text, "replay")
    writer = RunWriter(folder / "run.mcap", header.metadata, {ATTACHMENT: truth.attachment()})
    for seq, (t, x, y, heading) in enumerate(rows.tolist()):
        tick = Tick(seq, round(t * 1e9), None, ())
        estimate = estimate_at(tick.stamp_ns, Pose2(x, y, heading), Pose2(x, y, heading))
        writer.add(tick_records(CompletedTick(tick, estimate, make_timing(seq), bytes(16), None)))
    writer.close()


def test_the_gps_of_a_data_set_is_laid_onto_the_map(tmp_path: Path) -> None:
    write_imported_run(tmp_path / "run", Pose2(400.0, -90.0, 2.0), 0.0)
    track = truth_track(RunReader(tmp_path / "run"))
    assert track is not None
    assert (track.name, len(track.places_m)) == ("GPS", 60)
    np.testing.assert_allclose(track.errors_m, 0.0, atol=1e-6)
    np.testing.assert_allclose(track.landmarks_m, [[5.0, 6.0]], atol=1e-6)
    first = Pose2(*path()[0, 1:].tolist()) @ Pose2(CONFIGURATION.slam.mount.x_m, CONFIGURATION.slam.mount.y_m, 0.0)
    np.testing.assert_allclose(track.places_m[0], first.as_array()[:2], atol=1e-6)


def test_the_review_of_an_import_shows_its_truth_and_the_error_there(tmp_path: Path) -> None:
    write_imported_run(tmp_path / "run", Pose2(400.0, -90.0, 2.0), 2.0)
    build_review(tmp_path / "run", tmp_path / "review.rrd")
    drawn = Drawn(tmp_path / "review.rrd")
    assert sum(len(row) for row in drawn.values[("/map/truth_places", "positions")]) == 60
    errors_m = [row[0] for row in drawn.values[("/plots/error/SLAM_m", "scalars")]]
    assert len(errors_m) == 60
    assert np.median(errors_m) < 0.5 < max(errors_m)
    assert ("/map/truth_landmarks", "positions") in drawn.values


def test_the_review_of_an_import_is_that_of_its_newest_replay(tmp_path: Path) -> None:
    imported = RunFolder(tmp_path / "run")
    imported.path.mkdir()
    header = RunHeader(load_configuration_text("").text, "import of a set")
    RunWriter(imported.mcap_path, header.metadata).close()
    replay = imported.replays_path / "one"
    write_imported_run(replay, Pose2(), 0.0)
    (replay / "summary.json").write_text("{}")
    assert review_paths(imported) == [replay / "review.rrd"]


def test_names_do_not_lie_over_one_another_and_say_how_many_there_are() -> None:
    points_m = np.array(((0.0, 0.0), (0.5, 0.1), (0.4, -0.2), (0.2, 0.1), (9.0, 0.0), (0.0, 3.0)))
    labels = ["difference", "difference", "density", "difference", "difference", "new"]
    chosen, words = beside_each_other(points_m, labels, (3.0, 1.0))
    assert chosen == [0, 4, 5]
    assert words == ["difference x 3", "difference", "new"]
    assert beside_each_other(np.empty((0, 2)), [], (3.0, 1.0)) == ([], [])
