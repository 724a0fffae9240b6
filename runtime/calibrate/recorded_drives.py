"""Recorded runs as drives to calibrate from, and the geometry that their configuration believes in."""

from collections.abc import Sequence
from pathlib import Path

from drivers.measurements import OdometryPose, Scan, SpeedSteering, WheelCounts
from runtime.calibrate.calibration import calibrate
from runtime.calibrate.drive_data import CalibrationStart, DriveData, PoseStart, Start, SteeringStart
from runtime.calibrate.result import Calibration
from runtime.errors import DataSetError
from runtime.record.reader import RunReader
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.tick import of_its_time
from slam.settings.slam import MountSettings


def calibrate_runs(
    runs: Sequence[Path], configuration: Configuration | None = None
) -> tuple[Calibration, Configuration]:
    """Calibrate from runs; the search begins at `configuration`, else at what the first run was recorded with.

    Gives back that configuration too: write_configuration puts the result into it. Raises NotARunError, DataSetError.
    """
    if not runs:
        raise DataSetError("no run given; name at least one to calibrate from")
    believed = configuration or recorded_configuration(runs[0])
    mount = believed.slam.mount
    return calibrate([load_drive(run, mount) for run in runs], start_from(believed)), believed


def load_drive(run: Path, mount: MountSettings | None = None) -> DriveData:
    """Every wheel sample of a run and every scan as a laser that stands upright would have seen it.

    mount: as configured; without one scans stay as they were recorded. Raises NotARunError; DataSetError where the
    odometry is of no use here.
    """
    scans: list[Scan] = []
    counts: list[WheelCounts] = []
    speeds: list[SpeedSteering] = []
    poses: list[OdometryPose] = []
    for recorded in RunReader(run).ticks():
        tick = of_its_time(recorded.tick)
        if isinstance(tick.scan, Scan):
            scans.append(tick.scan if mount is None else mount.upright(tick.scan))
        for sample in tick.wheels:
            if isinstance(sample, WheelCounts):
                counts.append(sample)
            elif isinstance(sample, SpeedSteering):
                speeds.append(sample)
            elif isinstance(sample, OdometryPose):
                poses.append(sample)
            else:
                raise DataSetError(
                    f"{run}: its odometry is {type(sample).__name__}, expected wheel counts, speed and steering, or "
                    "poses; calibrate from another run"
                )
    if sum(map(bool, (counts, speeds, poses))) > 1:
        raise DataSetError(f"{run}: mixes kinds of odometry, expected one of them; import it again")
    return DriveData(run.name, tuple(scans), tuple(counts) or tuple(speeds) or tuple(poses))


def recorded_configuration(run: Path) -> Configuration:
    """What a run was recorded with. Raises NotARunError, ConfigurationError."""
    return load_configuration_text(RunReader(run).header.configuration_text, source=f"configuration of {run}")


def start_from(configuration: Configuration) -> Start:
    """Where the search begins. Raises DataSetError where the odometry is of a kind that has no wheels to calibrate.

    The latency begins at zero: stamps in a record already hold the configuration's laser.stamp_offset_s.
    """
    odometry, mount = configuration.slam.odometry, configuration.slam.mount.as_pose()
    if odometry.model == "steered":
        return SteeringStart(
            steering_scale=odometry.steering_scale,
            steering_bias_rad=odometry.steering_bias_rad,
            wheel_base_m=odometry.wheel_base_m,
            speed_wheel_offset_m=odometry.speed_wheel_offset_m,
            body_from_laser=mount,
        )
    if odometry.model == "pose":
        return PoseStart(body_from_laser=mount)
    if odometry.model != "differential":
        raise DataSetError(
            f"vehicle.motion_model = {odometry.model!r}: expected 'differential', 'steered' or 'pose'; "
            "there is nothing to calibrate"
        )
    return CalibrationStart(
        odometry.wheel_radius_left_m, odometry.wheel_radius_right_m, odometry.tread_m, odometry.counts_per_rev, mount
    )
