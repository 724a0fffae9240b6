from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import OdometryPose, Scan, SpeedYawRate, WheelCounts, WheelSample
from runtime.calibrate.drive_data import CalibrationStart, PoseStart, SteeringStart
from runtime.calibrate.recorded_drives import calibrate_runs, load_drive, recorded_configuration, start_from
from runtime.errors import DataSetError, NotARunError
from runtime.messages.records import tick_records
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.settings.configuration import load_configuration_text
from runtime.tick import CompletedTick, Tick
from slam.settings.slam import MountSettings
from tests.support.runtime.made_drives import BOOT_NS, Rover, park_drive
from tests.support.runtime.recorded_values import make_estimate, make_timing

CONFIGURATION = "[slam.mount]\nx_m = 0.25\n[vehicle]\ntread_m = 0.52\n"


def _record(folder: Path, ticks: list[Tick]) -> Path:
    folder.mkdir()
    rng = np.random.default_rng(1)
    file = RecordFile(folder / "run.mcap", RunHeader(CONFIGURATION, "live").metadata, {})
    for tick in ticks:
        estimate = make_estimate(tick.stamp_ns, rng, 1081)
        for record in tick_records(CompletedTick(tick, estimate, make_timing(tick.seq), bytes(16), None)):
            file.add(record)
    file.finish()
    file.write()
    file.close()
    return folder


def _ticks(scans: tuple[Scan, ...], wheels: tuple[WheelSample, ...]) -> list[Tick]:
    """Each scan with the wheel samples since the one before."""
    ticks, first = [], 0
    for seq, scan in enumerate(scans):
        last = first
        while last < len(wheels) and wheels[last].stamp_ns <= scan.stamp_ns + 100_000_000:
            last += 1
        ticks.append(Tick(seq, scan.stamp_ns + 100_000_000, scan, tuple(wheels[first:last])))
        first = last
    return ticks


def test_a_run_gives_back_the_drive_that_was_recorded(tmp_path: Path) -> None:
    drive = park_drive(4, Rover(), 12.0)
    folder = _record(tmp_path / "run", _ticks(drive.scans, drive.wheels))
    again = load_drive(folder)
    assert [scan.stamp_ns for scan in again.scans] == [scan.stamp_ns for scan in drive.scans]
    np.testing.assert_allclose(again.scans[20].ranges_m, drive.scans[20].ranges_m, atol=6e-4)  # millimetres
    assert again.wheels == drive.wheels[: len(again.wheels)]
    assert len(again.wheels) > 500
    result, believed = calibrate_runs([folder])
    assert believed == recorded_configuration(folder)
    assert result.drives == ("run",)
    assert result.quantity("range_noise_m").value == pytest.approx(0.015, rel=0.1)


def test_the_search_begins_at_what_the_configuration_says() -> None:
    start = start_from(load_configuration_text(CONFIGURATION))
    assert isinstance(start, CalibrationStart)
    assert (start.tread_m, start.body_from_laser.x_m, start.latency_s) == (0.52, 0.25, 0.0)
    steered = start_from(load_configuration_text('[vehicle]\nmotion_model = "steered"\nsteering_bias_rad = 0.01\n'))
    assert isinstance(steered, SteeringStart)
    assert steered.steering_bias_rad == 0.01


def test_odometry_that_is_neither_wheels_nor_poses_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(DataSetError, match=r"vehicle\.motion_model"):
        start_from(load_configuration_text('[vehicle]\nmotion_model = "speed_yaw_rate"\n'))
    folder = _record(tmp_path / "run", [Tick(0, BOOT_NS, None, (SpeedYawRate(BOOT_NS, 0.0, 0.0),))])
    with pytest.raises(DataSetError, match="SpeedYawRate"):
        load_drive(folder)
    mixed = (WheelCounts(BOOT_NS, 0.0, 0.0), OdometryPose(BOOT_NS + 1, 0.0, 0.0, 0.0))
    with pytest.raises(DataSetError, match="mixes"):
        load_drive(_record(tmp_path / "mixed", [Tick(0, BOOT_NS, None, mixed)]))


def test_poses_of_a_base_are_a_drive_too(tmp_path: Path) -> None:
    poses = tuple(OdometryPose(BOOT_NS + k, 0.1 * k, 0.0, 0.0) for k in range(3))
    assert load_drive(_record(tmp_path / "run", [Tick(0, BOOT_NS, None, poses)])).wheels == poses
    start = start_from(load_configuration_text('[vehicle]\nmotion_model = "pose"\n[slam.mount]\nx_m = 0.2\n'))
    assert isinstance(start, PoseStart)
    assert start.body_from_laser.x_m == 0.2


def test_what_is_stamped_from_the_future_is_left_out(tmp_path: Path) -> None:
    drive = park_drive(4, Rover(), 3.0)
    ticks = _ticks(drive.scans, drive.wheels)
    hour_ns = 3600 * 10**9
    late_scan = replace(drive.scans[5], stamp_ns=drive.scans[5].stamp_ns + hour_ns)
    ticks[5] = replace(ticks[5], scan=late_scan, wheels=(WheelCounts(BOOT_NS + hour_ns, 0.0, 0.0),))
    again = load_drive(_record(tmp_path / "run", ticks))
    assert len(again.scans) == len(drive.scans) - 1
    assert max(sample.stamp_ns for sample in again.wheels) < BOOT_NS + hour_ns


def test_scans_of_a_laser_upside_down_are_turned_up(tmp_path: Path) -> None:
    drive = park_drive(4, Rover(), 2.0)
    folder = _record(tmp_path / "run", _ticks(tuple(scan.mirrored() for scan in drive.scans), drive.wheels))
    again = load_drive(folder, MountSettings(upside_down=True))
    np.testing.assert_allclose(again.scans[3].ranges_m, drive.scans[3].ranges_m, atol=6e-4)
    np.testing.assert_allclose(again.scans[3].bearings_rad, drive.scans[3].bearings_rad)


def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotARunError):
        load_drive(tmp_path)
    with pytest.raises(DataSetError, match="no run given"):
        calibrate_runs([])


def test_wheels_in_a_run_keep_what_they_did_not_know(tmp_path: Path) -> None:
    wheels = (WheelCounts(BOOT_NS, 1.0, 2.0), WheelCounts(BOOT_NS + 1, 1.0, 2.0, False))
    folder = _record(tmp_path / "run", [Tick(0, BOOT_NS, None, wheels)])
    assert load_drive(folder).wheels == wheels
