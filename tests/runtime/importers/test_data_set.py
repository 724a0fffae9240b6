"""Recorded data sets become runs: nothing lost, nothing invented, nothing written when something is missing."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import (
    OdometryPose,
    Scan,
    Sightings,
    SpeedSteering,
    SpeedYawRate,
    WheelCounts,
    WheelSample,
    uniform_bearings,
)
from runtime.errors import ConfigurationError, DataSetError, RunExistsError
from runtime.evaluate.truth import DataSetTruth
from runtime.importers.archive import load_archive
from runtime.importers.data_set import FAMILIES, import_data_set
from runtime.importers.sightings import seen
from runtime.importers.ticks import LONG_NS, ticks
from runtime.importers.truth import truth_of
from runtime.importers.wheel_streams import agreeing_poses, wheel_samples
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration
from runtime.source_tree import CONFIG
from slam.pose import Pose2, wrap_rad
from tests.support.runtime.data_sets import SCANS, write_set

STEERED: dict[str, Any] = {
    "odom_t": np.arange(99.95, 101.5, 0.05),
    "odom_v": np.full(31, 2.0),
    "odom_steer": np.full(31, 0.1),
    "odom_steer_cal": np.full(31, 0.2),
}


@pytest.fixture
def steered(tmp_path: Path) -> Path:
    path = tmp_path / "steered.toml"
    path.write_text("[vehicle]\nmotion_model = 'steered'\nmax_speed_mps = 10.0\n")
    return path


def test_values_that_mean_no_return_become_nan_and_all_others_stay(tmp_path: Path) -> None:
    scans = list(seen(load_archive(write_set(tmp_path / "a", SCANS | STEERED))))
    assert all(isinstance(scan, Scan) for scan in scans)
    assert np.array_equal(scans[0].ranges_m, SCANS["ranges"][0])
    assert np.isnan(scans[1].ranges_m).all()
    assert np.array_equal(np.isnan(scans[2].ranges_m), [False, True, False, False, False])
    assert np.array_equal(scans[0].bearings_rad, uniform_bearings(-1.0, 0.5, 5))


def test_the_better_steering_calibration_is_used(tmp_path: Path) -> None:
    samples = wheel_samples(load_archive(write_set(tmp_path / "a", SCANS | STEERED)))
    assert samples[0] == SpeedSteering(0, 2.0, 0.2)


def test_stamps_count_from_the_start_of_the_set(tmp_path: Path) -> None:
    archive = load_archive(write_set(tmp_path / "a", SCANS | STEERED))
    assert archive.start_s == 99.95
    assert archive.stamps_ns("scan_t") == [50_000_000, 250_000_000, 1_050_000_000]


def test_an_import_holds_every_scan_and_every_wheel_sample(tmp_path: Path, steered: Path) -> None:
    source = write_set(tmp_path / "a", SCANS | STEERED)
    summary = import_data_set(source, tmp_path / "run", steered)
    recorded = [again.tick for again in RunReader(tmp_path / "run").ticks()]
    assert [sample for tick in recorded for sample in tick.wheels] == wheel_samples(load_archive(source))
    assert [tick.scan.stamp_ns for tick in recorded if tick.scan] == [50_000_000, 250_000_000, 1_050_000_000]
    assert summary["scans"] == 3
    assert summary["ticks"] == len(recorded)
    assert RunReader(tmp_path / "run").header.source == "import victoria_park"


def test_the_lasers_latency_is_taken_off_its_stamps_and_off_no_others(tmp_path: Path) -> None:
    source = write_set(tmp_path / "set", SCANS | STEERED)
    late = tmp_path / "late.toml"
    late.write_text("[data_set]\nlaser_latency_s = 0.06\n[vehicle]\nmotion_model = 'steered'\n")
    imported = import_data_set(source, tmp_path / "run", late)
    assert imported["laser_latency_s"] == 0.06
    found = [recorded.tick for recorded in RunReader(tmp_path / "run").ticks()]
    stamps_ms = [tick.scan.stamp_ns / 1e6 for tick in found if tick.scan is not None]
    assert stamps_ms == pytest.approx([0.0, 200.0, 1000.0]), "the first scan was measured before anything else was"
    assert [tick.stamp_ns / 1e6 for tick in found if tick.scan is not None] == pytest.approx(stamps_ms)
    first = next(sample for tick in found for sample in tick.wheels)
    assert first.stamp_ns == 10_000_000


@pytest.mark.parametrize(
    ("arrays", "meta", "said"),
    [
        (SCANS, None, "has no odometry"),
        (STEERED, None, "neither scans"),
        (SCANS | {"odom_t": STEERED["odom_t"]}, None, "odometry of an unknown kind"),
        (SCANS | STEERED, {}, "no array named meta"),
        (SCANS | STEERED, {"name": "mars"}, "no configuration known for 'mars'"),
    ],
)
def test_a_set_that_lacks_something_is_refused_in_one_sentence(
    tmp_path: Path, arrays: dict[str, Any], meta: dict[str, Any] | None, said: str
) -> None:
    source = write_set(tmp_path / "a", arrays, meta)
    with pytest.raises(DataSetError, match=said) as caught:
        import_data_set(source, tmp_path / "run")
    assert caught.value.exit_code == 3
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\3\4 torn"])
def test_a_file_that_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ConfigurationError, match="cannot be read as a data set"):
        import_data_set(tmp_path / "a.npz", tmp_path / "run")


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_a_configuration_that_loads(family: str) -> None:
    assert load_configuration(CONFIG / f"{family}.toml").rover == family


def test_a_source_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataSetError, match="nowhere"):
        import_data_set(tmp_path / "nowhere", tmp_path / "run")


def test_an_import_never_overwrites(tmp_path: Path) -> None:
    source = write_set(tmp_path / "a", SCANS | STEERED)
    import_data_set(source, tmp_path / "run")
    with pytest.raises(RunExistsError):
        import_data_set(source, tmp_path / "run")


@given(
    st.lists(st.integers(1, 3_000), min_size=1, max_size=30),
    st.lists(st.integers(1, 400), min_size=1, max_size=80),
    st.sampled_from((50, 100)),
)
def test_ticks_hold_all_in_order_and_leave_no_avoidable_hole(
    scan_steps_ms: list[int], wheel_steps_ms: list[int], spacing_ms: int
) -> None:
    scans = [_scan(stamp_ms) for stamp_ms in itertools.accumulate(scan_steps_ms)]
    wheels: list[WheelSample] = [WheelCounts(ms * 10**6, 0.0, 0.0) for ms in itertools.accumulate(wheel_steps_ms)]
    made = list(ticks(scans, wheels, spacing_ms * 10**6))
    stamps_ns = [tick.stamp_ns for tick in made]
    assert stamps_ns == sorted(set(stamps_ns))
    assert [tick.seq for tick in made] == list(range(len(made)))
    assert [tick.scan for tick in made if tick.scan is not None] == scans
    held = [sample for tick in made for sample in tick.wheels]
    assert held == wheels
    assert all(sample.stamp_ns <= tick.stamp_ns for tick in made for sample in tick.wheels)
    for before, after in itertools.pairwise(stamps_ns):
        if after - before > LONG_NS:
            inside = [w.stamp_ns for w in wheels if before + spacing_ms * 10**6 <= w.stamp_ns <= after - 50_000_000]
            assert not inside


def _scan(stamp_ms: int) -> Scan:
    return Scan(stamp_ms * 10**6, np.ones(3, np.float32), np.zeros(3))


def random_walk(rng: np.random.Generator, count: int) -> list[Pose2]:
    poses = [Pose2()]
    for _ in range(count - 1):
        poses.append(poses[-1] @ Pose2(rng.random() * 0.2, 0.0, rng.normal() * 0.1))
    return poses


def test_the_scans_own_odometry_is_kept_exactly(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    stamps_ns = list(range(0, 4000, 100))
    poses = random_walk(rng, 40)
    scan_stamps_ns = [550, 1210, 3300]
    scan_poses = [pose @ Pose2(*rng.normal(size=3) * 0.05) for pose in (poses[5], poses[12], poses[33])]
    samples = agreeing_poses(stamps_ns, poses, scan_stamps_ns, scan_poses)
    by_stamp = {sample.stamp_ns: sample for sample in samples}
    for stamp_ns, pose in zip(scan_stamps_ns, scan_poses, strict=True):
        assert by_stamp[stamp_ns] == OdometryPose(stamp_ns, pose.x_m, pose.y_m, pose.heading_rad)
    assert [sample.stamp_ns for sample in samples] == sorted({*stamps_ns, *scan_stamps_ns})


def test_what_the_log_says_otherwise_is_shared_out_over_the_way() -> None:
    poses = [Pose2(0.1 * k, 0.0, 0.0) for k in range(21)]
    stamps_ns = list(range(0, 2100, 100))
    samples = agreeing_poses(stamps_ns, poses, [0, 2000], [poses[0], Pose2(2.2, 0.2, 0.0)])
    steps_m = [b.x_m - a.x_m for a, b in itertools.pairwise(samples)]
    np.testing.assert_allclose(steps_m, 0.11, atol=1e-9)
    np.testing.assert_allclose([b.y_m - a.y_m for a, b in itertools.pairwise(samples)], 0.01, atol=1e-9)


def test_a_base_that_stands_in_the_log_stands() -> None:
    poses = [Pose2(0.1 * min(k, 10), 0.0, 0.0) for k in range(21)]
    samples = agreeing_poses(list(range(0, 2100, 100)), poses, [0, 2000], [poses[0], Pose2(1.2, 0.0, 0.0)])
    np.testing.assert_allclose([sample.x_m for sample in samples[10:]], 1.2, atol=1e-9)


def test_odometry_that_agrees_already_is_not_bent() -> None:
    poses = random_walk(np.random.default_rng(2), 40)
    stamps_ns = list(range(0, 4000, 100))
    samples = agreeing_poses(stamps_ns, poses, [1000, 2500], [poses[10], poses[25]])
    for sample in samples:
        pose = poses[sample.stamp_ns // 100]
        assert math.hypot(sample.x_m - pose.x_m, sample.y_m - pose.y_m) < 1e-12
        assert abs(wrap_rad(sample.heading_rad - pose.heading_rad)) < 1e-12


def test_sightings_of_one_instant_are_one_value_without_other_robots(tmp_path: Path) -> None:
    source = write_set(
        tmp_path / "a",
        {
            "odom_t": np.array([0.0, 1.0]),
            "odom_v": np.array([0.1, 0.1], np.float32),
            "odom_w": np.zeros(2, np.float32),
            "obs_t": np.array([0.5, 0.5, 0.5, 0.7]),
            "obs_id": np.array([2, 7, -1, 8], np.int16),
            "obs_range": np.array([1.0, 2.0, 3.0, 4.0], np.float32),
            "obs_bearing": np.zeros(4, np.float32),
        },
        {"name": "mrclam_x"},
    )
    archive = load_archive(source)
    first, second = seen(archive)
    assert isinstance(first, Sightings)
    assert first.identities.tolist() == [7, -1]
    assert first.ranges_m.tolist() == [2.0, 3.0]
    assert second.stamp_ns == 700_000_000
    assert isinstance(wheel_samples(archive)[0], SpeedYawRate)


def test_truth_travels_inside_the_run(tmp_path: Path, steered: Path) -> None:
    fixes = {"gt_t": np.array([99.95, 100.5]), "gt_xy": np.array([[1.0, 2.0], [3.0, 4.0]])}
    source = write_set(tmp_path / "a", SCANS | STEERED | fixes | {"gt_good": np.array([False, True])})
    import_data_set(source, tmp_path / "run", steered)
    truth = DataSetTruth.from_attachments(RunReader(tmp_path / "run").attachments)
    assert truth is not None
    assert truth.fixes is not None
    np.testing.assert_allclose(truth.fixes, [[0.55, 3.0, 4.0]])
    assert truth.poses is None
    assert truth_of(load_archive(write_set(tmp_path / "b", SCANS | STEERED))) is None


KINDS = {
    "victoria_park": SpeedSteering,
    "minesparis_exp1": WheelCounts,
    "minesparis_exp2": WheelCounts,
    "intel_lab": OdometryPose,
    "aces_austin": OdometryPose,
    "sjursflat": WheelCounts,
    "mrclam_d6_r1": SpeedYawRate,
}


@pytest.mark.parametrize("name", ["minesparis_exp1", "sjursflat", "intel_lab", "mrclam_d6_r1"])
def test_real_recordings_are_imported_whole(recorded_data: Callable[[str], Path], tmp_path: Path, name: str) -> None:
    source = recorded_data(name)
    summary = import_data_set(source, tmp_path / "run")
    recorded = [again.tick for again in RunReader(tmp_path / "run").ticks()]
    scans = [tick for tick in recorded if tick.scan is not None]
    samples = [sample for tick in recorded for sample in tick.wheels]
    assert all(type(sample) is KINDS[name] for sample in samples)
    assert len(scans) == summary["scans"]
    assert len(samples) == summary["wheel_samples"]
    assert RunReader(tmp_path / "run").truncated == ""


def test_a_real_recording_without_odometry_is_refused(recorded_data: Callable[[str], Path], tmp_path: Path) -> None:
    with pytest.raises(DataSetError, match="has no odometry"):
        import_data_set(recorded_data("people_walk1"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_speeds_that_were_commanded_count_when_the_robot_follows_them(recorded_data: Callable[[str], Path]) -> None:
    archive = load_archive(recorded_data("mrclam_d6_r1"))
    samples, stamps_ns = wheel_samples(archive), archive.stamps_ns("odom_t")
    later = [sample.stamp_ns - stamp_ns for sample, stamp_ns in zip(samples, stamps_ns, strict=True)]
    assert set(later) == {200_000_000}
