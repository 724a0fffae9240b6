"""The calibrated values in a configuration file, new or the one that is there, ready for the next run."""

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

import tomli_w

from drivers.settings.wheel_signals import WheelSignals
from runtime.atomic_write import atomic_write
from runtime.calibrate.result import Calibration, calibration_lines
from runtime.errors import ConfigurationError, StorageError
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.settings.trees import Tree, copy_of, take, value_at, with_value
from runtime.setup.validation import UNCERTAINTIES
from runtime.source_tree import shipped_configuration
from slam.pose import wrap_rad

LATENCIES = ("laser.stamp_offset_s", "data_set.laser_latency_s")
UPSIDE_DOWN = "slam.mount.upside_down"
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


def text_to_write_into(path: Path, config: Path | None = None) -> str | None:
    """The text of the file that is there, else that of `config`, else None; asked before the work begins.

    Raises ConfigurationError where it is no configuration or cannot be changed, StorageError where there is no writing.
    """
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK) or path.is_dir():
        raise StorageError(f"{path}: cannot be written; give a file in a folder that exists and is writable")
    _refuse_link_of_another(path)
    base = path if path.exists() else config
    if base is None:
        return None
    _refuse_what_cancels(load_configuration(base), base)
    base = shipped_configuration(base)
    try:
        text = base.read_bytes().decode()
    except OSError as error:
        raise StorageError(f"{base}: cannot be read ({error.strerror})") from error
    tried = text
    for key in (*DIRECT.values(), *UNCERTAINTIES, *LATENCIES, UPSIDE_DOWN):
        tried = with_value(tried, key, value=False)
    return text


def _refuse_link_of_another(path: Path) -> None:
    """A link of ours is followed, as to the configuration in a checkout; one that somebody else has put here is not."""
    if path.is_symlink() and (path.lstat().st_uid not in (0, os.geteuid()) or not path.exists()):
        where = "to nothing" if not path.exists() else "of another user"
        raise StorageError(f"{path}: is a link {where}, which is not followed; remove it, or give another name")


def _refuse_what_cancels(configuration: Configuration, path: Path) -> None:
    """A node that sends metres has put a radius into them; where that is not undone, ours changes nothing."""
    layout = None if configuration.encoders is None else configuration.encoders.layout
    for side in ("left", "right"):
        signals = getattr(layout, side, None)
        if isinstance(signals, WheelSignals) and not signals.is_scaled_by_radius:
            raise ConfigurationError(
                f"{path}: encoders.layout.{side}.counts_per_unit: expected the counts in a metre, because the speed is "
                f"in {signals.speed_unit} and a calibrated radius would change nothing; "
                f"add counts_per_unit = {configuration.vehicle.counts_per_metre:.6g}"
            )


def write_configuration(result: Calibration, believed: str, path: Path, into: str | None = None) -> tuple[str, ...]:
    """Put what was found into a text and write it to `path` whole or not at all; gives the keys that changed.

    A file that is there is kept under another name. believed: the configuration that the search began with; into: the
    text that is changed, by default the settings of `believed` that are not the defaults. Comments stay; refused values
    keep what is there. Raises ConfigurationError where nothing was found or a text is wrong, StorageError where it
    cannot be written.
    """
    changes = configuration_changes(result, believed)
    if not changes:
        raise ConfigurationError(f"{path}: not written, because the drive showed nothing; {'; '.join(result.missing)}")
    text = _heading(result) + without_defaults(believed) if into is None else into
    tree = tomllib.loads(text)
    changes = {key: value for key, value in changes.items() if value_at(tree, key) != value}
    for key, value in changes.items():
        text = with_value(text, key, value)
    load_configuration_text(text, source=str(path), recorded=False)
    try:
        target = path.resolve()
        mode = target.stat().st_mode & 0o777 if target.exists() else None
        if mode is not None and changes:
            atomic_write(backup_of(target), target.read_bytes(), mode)
        atomic_write(target, text, mode)
    except OSError as error:
        raise StorageError(f"{path}: cannot be written ({error.strerror}); give a file in a writable folder") from error
    return tuple(changes)


def backup_of(path: Path) -> Path:
    """Where a file is kept as it was before the last calibration."""
    return path.with_name(f"{path.name}.before")


def without_defaults(text: str) -> str:
    """A configuration's text less every line without which it says the same."""
    tree = tomllib.loads(text)
    whole = load_configuration_text(text, recorded=False)
    for key in (*_leaves(tree), *tree):  # values first, then the tables that they have left empty
        shorter = copy_of(tree)
        if isinstance(take(shorter, key), dict) and tree[key]:
            continue
        try:
            if load_configuration_text(tomli_w.dumps(shorter), recorded=False) == whole:
                tree = shorter
        except ConfigurationError:
            continue
    return tomli_w.dumps(tree)


def _leaves(tree: Tree, path: str = "") -> Iterator[str]:
    for name, value in tree.items():
        key = f"{path}.{name}".lstrip(".")
        yield from _leaves(value, key) if isinstance(value, dict) else (key,)


def _heading(result: Calibration) -> str:
    return "".join(f"# {line}\n" for line in calibration_lines(result)) + "\n"


def configuration_changes(result: Calibration, base_toml: str) -> dict[str, float | bool]:
    """Key and new value of everything that was found and has a place in this configuration."""
    believed = load_configuration_text(base_toml, source="base configuration")
    changes: dict[str, float | bool] = {}
    for name, key in DIRECT.items():
        if (quantity := result.reported(name)) is not None:
            changes[key] = max(round(quantity.value, 6), LEAST.get(key, -1e9))
    if (yaw := result.reported("laser_yaw_rad")) is not None:
        changes[DIRECT[yaw.name]] = round(wrap_rad(yaw.value), 6)
    if result.orientation.mirrored:
        changes[UPSIDE_DOWN] = not believed.slam.mount.upside_down
    changes |= _uncertainties(result)
    latency = result.reported("laser_latency_s")
    if believed.laser is not None and latency is not None:
        changes[LATENCIES[0]] = round(believed.laser.stamp_offset_s - latency.value, 6)
    elif latency is not None:  # a recorded data set: its importer takes it off the next time
        taken_off_s = believed.data_set.laser_latency_s if believed.data_set is not None else 0.0
        changes[LATENCIES[1]] = round(taken_off_s + latency.value, 6)
    return changes


def _uncertainties(result: Calibration) -> dict[str, float | bool]:
    """What the filter assumes of the constants that stay a little wrong: half an interval is two deviations."""
    shares = {}
    for name in ("wheel_radius_left_m", "wheel_radius_right_m", "tread_m"):
        if (quantity := result.reported(name)) is not None:
            shares[name] = quantity.half_width / 2.0 / quantity.value
    changes: dict[str, float | bool] = {}
    radii = [share for name, share in shares.items() if name != "tread_m"]
    if len(radii) == 2:
        changes[UNCERTAINTIES[0]] = round(max(radii), 5)
    if "tread_m" in shares:
        changes[UNCERTAINTIES[1]] = round(shares["tread_m"], 5)
    return changes
