"""Where a data set says that its laser sits, and how that meets what the configuration says."""

import json
import math
from collections.abc import Mapping
from typing import Any

from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.parsing.checks import number
from runtime.settings.configuration import Configuration
from slam.pose import wrap_rad

NAMES = {
    "x_m": ("laser_x", "laser_x_m", "laser_offset_m", "laser_offset"),
    "y_m": ("laser_y", "laser_y_m"),
    "yaw_rad": ("laser_yaw", "laser_yaw_rad", "laser_theta"),
}
FARTHEST = {"x_m": 20.0, "y_m": 20.0, "yaw_rad": 2.0 * math.pi + 0.01}  # some write 6.2832
SAME = 1e-3  # m or rad: a difference that nobody measures


def mount_of(archive: Archive) -> dict[str, float]:
    """Keys of [slam.mount] that the set's description gives, in `vehicle`, `geometry` or beside them.

    Raises DataSetError for a value that cannot be a place on a vehicle.
    """
    mount: dict[str, float] = {}
    for table in ("", "geometry", "vehicle"):
        told = archive.meta.get(table, {}) if table else archive.meta
        if not isinstance(told, Mapping):
            raise DataSetError(f"{archive.path}: meta.{table} = {told!r}, expected a table such as {{laser_x: 0.25}}")
        for key, names in NAMES.items():
            for name in (name for name in names if name in told):
                value = _place(archive, f"{table}.{name}".lstrip("."), told[name], FARTHEST[key])
                mount[key] = min(max(wrap_rad(value), -math.pi), math.pi) if key == "yaw_rad" else value
        if "laser_upside_down" in told:
            if not isinstance(told["laser_upside_down"], bool):
                raise DataSetError(
                    f"{archive.path}: meta.laser_upside_down = {told['laser_upside_down']!r}, expected true or false"
                )
            mount["upside_down"] = told["laser_upside_down"]
        if "(a,b)" in str(told.get("laser", "")):  # Victoria Park's own words: metres ahead and left of the axle
            mount |= {key: _place(archive, name, told.get(name), 20.0) for key, name in (("x_m", "a"), ("y_m", "b"))}
    return mount


def merged_mount(mount: Mapping[str, float], configuration: Configuration) -> tuple[dict[str, str], list[str]]:
    """(overrides, notes): what the set knows and the configuration does not say; where both say it, the file wins.

    A configuration that says otherwise is named in a sentence; one that leaves a key out takes the set's.
    """
    file_mount, missing = configuration.slam.mount, _missing(mount, configuration)
    notes = []
    for key, value in mount.items():
        if abs(getattr(file_mount, key) - value) <= SAME:
            continue
        if f"slam.mount.{key}" in missing:
            notes.append(f"slam.mount.{key} = {value:g} is taken from the data set's description")
        else:
            notes.append(
                f"slam.mount.{key} = {getattr(file_mount, key):g} of the configuration is used; the data set's "
                f"description says {value:g}"
            )
    return missing, notes


def mount_of_import(recorded: Configuration, configuration: Configuration) -> dict[str, str]:
    """Overrides that give a configuration the mount with which a run was imported, for the keys that it leaves out."""
    return _missing(recorded.slam.mount.model_dump(), configuration)


def _missing(mount: Mapping[str, float], configuration: Configuration) -> dict[str, str]:
    """Keys of a mount that a configuration does not set, as overrides."""
    slam = configuration.slam
    in_file = slam.mount.model_fields_set if "mount" in slam.model_fields_set else set()
    return {f"slam.mount.{key}": json.dumps(value) for key, value in mount.items() if key not in in_file}


def _place(archive: Archive, name: str, value: Any, farthest: float) -> float:
    told = number(archive.path, name, value)
    if abs(told) > farthest:
        raise DataSetError(f"{archive.path}: meta.{name} = {told:g}, expected metres or radians within {farthest:.4g}")
    return told
