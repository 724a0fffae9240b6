"""The method in the simulated building: one and a tenth laps of 150 m round its corridors."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.measurements import Scan, uniform_bearings
from drivers.simulated.world.places.building import Building, building_settings
from runtime.evaluate.errors import trajectory_error
from runtime.importers.data_set import FAST_SPACING_NS
from runtime.importers.ticks import ticks
from runtime.studies.jobs import Result
from runtime.studies.loss_detection.drives import WheelReadings
from runtime.studies.places.drive import driven
from runtime.studies.places.figures import quality_shares
from runtime.tick import Tick
from slam.estimate import Quality
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings

LAPS = 1.1


def building_drive(
    seed: int,
    rate_hz: float,
    beam_count: int,
    slam: dict[str, Any],
    code: str,  # noqa: ARG001  names the job
    laps: float = LAPS,
) -> Result:
    """Figures of one drive of published pose and odometry, in the frame of the start pose and after the rigid fit.

    slam: settings of slam that differ from the defaults, beside the mount, which is the world's.
    """
    building = Building(building_settings(seed, beam_count))
    mount_x_m, _, _ = building.settings.laser.body_from_laser
    estimator = Estimator(SlamSettings.model_validate({"mount": {"x_m": mount_x_m}, **slam}), seed)
    drive = driven(estimator, building_ticks(building, rate_hz, laps))
    points, headings = building.path.poses(drive.published[:, 0])
    truth = np.column_stack((points, headings))
    result: Result = {
        "way_m": float(building.path.arc_m(drive.published[-1:, 0])[0]),
        "landmarks": drive.landmarks,
        "defects": drive.defects,
        "cpu_s": float(drive.step_s.sum()),
        "step_max_s": float(drive.step_s.max()),
        "lost": drive.share_of(Quality.LOST),
    }
    for name, rows in (("published", drive.published), ("odometry", drive.odometry)):
        error = trajectory_error(rows[:, 1:], truth)
        result[f"{name}_rms_m"] = error.from_start.rms_m
        result[f"{name}_largest_m"] = error.from_start.largest_m
        result[f"{name}_aligned_rms_m"] = error.aligned.rms_m
    errors_m = np.hypot(*(drive.published[:, 1:3] - points).T)
    return result | quality_shares(errors_m, drive.sigma_m, drive.qualities)


def building_ticks(building: Building, rate_hz: float, laps: float = LAPS) -> Iterator[Tick]:
    """Scans at this rate, wheel samples at 50 Hz, as a recording of the drive would give them."""
    drive = building.settings.drive
    way_s = laps * building.path.course.length_m / drive.speed_mps
    until_ns = round((drive.rest_s + 0.5 * drive.ramp_s + way_s) * 1e9)
    wheels = WheelReadings(building.settings).until(until_ns)
    return ticks(_scans(building, round(1e9 / rate_hz), until_ns), list(wheels), FAST_SPACING_NS)


def _scans(building: Building, period_ns: int, until_ns: int) -> Iterator[Scan]:
    laser = building.settings.laser
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    middle = laser.beam_count // 2
    delay_ns = round(middle * laser.beam_period_s * 1e9)
    for start_ns in range(0, until_ns - delay_ns, period_ns):
        ranges = building.sweep_at(start_ns).ranges_m
        seen = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
        yield Scan(start_ns + delay_ns, seen, bearings, laser.beam_period_s, middle, laser.range_max_m)
