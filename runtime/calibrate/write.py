"""A configuration file with the calibrated values in it, ready for the next run."""

import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from runtime.calibrate.result import Calibration, calibration_lines
from runtime.errors import ConfigurationError, RunExistsError, StorageError
from runtime.settings.configuration import load_configuration_text

Tree = dict[str, Any]

DIRECT = {
    "wheel_radius_left_m": "vehicle.wheel_radius_left_m",
    "wheel_radius_right_m": "vehicle.wheel_radius_right_m",
    "tread_m": "vehicle.tread_m",
    "slip_m_per_sqrt_m": "slam.odometry.slip_m_per_sqrt_m",
    "lateral_m_per_sqrt_m": "slam.odometry.lateral_m_per_sqrt_m",
    "steering_scale": "vehicle.steering_scale",
    "steering_bias_rad": "vehicle.steering_bias_rad",
    "laser_x_m": "slam.mount.x_m",
    "laser_y_m": "slam.mount.y_m",
    "laser_yaw_rad": "slam.mount.yaw_rad",
    "range_noise_m": "slam.front_end.sigma_range_m",
}
LEAST = {
    # the filter needs some sideways noise (method: 1 mm a step); a drive that shows none does not take it away
    "slam.odometry.lateral_m_per_sqrt_m": 0.003,
    "slam.odometry.slip_m_per_sqrt_m": 0.001,
    "slam.front_end.sigma_range_m": 0.005,
}


def write_configuration(result: Calibration, base_toml: str, path: Path) -> tuple[str, ...]:
    """Put what was found into the configuration base_toml and write it to a new file; gives the keys that changed.

    Refused values keep what base_toml says. Raises ConfigurationError where nothing was found or base_toml is wrong,
    RunExistsError where the file exists, StorageError where it cannot be written.
    """
    changes = configuration_changes(result, base_toml)
    if not changes:
        raise ConfigurationError(f"{path}: not written, because the drive showed nothing; {'; '.join(result.missing)}")
    tree = tomllib.loads(base_toml)
    for key, value in changes.items():
        *tables, last = key.split(".")
        table = tree
        for name in tables:
            table = table.setdefault(name, {})
        table[last] = value
    text = "".join(f"# {line}\n" for line in calibration_lines(result)) + "\n" + tomli_w.dumps(tree)
    load_configuration_text(text, source=str(path), recorded=False)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise RunExistsError(f"{path}: exists already; give the name of a new file") from error
    except OSError as error:
        raise StorageError(f"{path}: cannot be written ({error.strerror}); give a folder that can") from error
    return tuple(changes)


def configuration_changes(result: Calibration, base_toml: str) -> dict[str, float]:
    """Key and new value of everything that was found and has a place in this configuration."""
    believed = load_configuration_text(base_toml, source="base configuration")
    changes: dict[str, float] = {}
    for name, key in DIRECT.items():
        if (quantity := result.reported(name)) is not None:
            changes[key] = max(round(quantity.value, 6), LEAST.get(key, -1e9))
    changes |= _uncertainties(result)
    latency = result.reported("laser_latency_s")
    if believed.laser is not None and latency is not None:
        changes["laser.stamp_offset_s"] = round(believed.laser.stamp_offset_s - latency.value, 6)
    elif latency is not None:  # a recorded data set: its importer takes it off the next time
        taken_off_s = believed.data_set.laser_latency_s if believed.data_set is not None else 0.0
        changes["data_set.laser_latency_s"] = round(taken_off_s + latency.value, 6)
    return changes


def _uncertainties(result: Calibration) -> dict[str, float]:
    """What the filter assumes of the constants that stay a little wrong: half an interval is two deviations."""
    shares = {}
    for name in ("wheel_radius_left_m", "wheel_radius_right_m", "tread_m"):
        if (quantity := result.reported(name)) is not None:
            shares[name] = quantity.half_width / 2.0 / quantity.value
    changes = {}
    radii = [share for name, share in shares.items() if name != "tread_m"]
    if len(radii) == 2:
        changes["slam.odometry.radius_uncertainty"] = round(max(radii), 5)
    if "tread_m" in shares:
        changes["slam.odometry.tread_uncertainty"] = round(shares["tread_m"], 5)
    return changes
