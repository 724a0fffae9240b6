"""The public recordings of a folder, and the two configurations that each is driven with."""

import json
import tomllib
import zipfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from runtime.errors import DataSetError
from runtime.importers.archive import Archive, load_archive
from runtime.importers.data_set import NEAREST, configuration_path, configured
from runtime.importers.wheel_streams import motion_model
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.settings.data_set import DataSetSettings
from runtime.source_tree import CONFIG

GEOMETRY = ("vehicle", "slam.front_end.kind", "slam.association.strategy")
"""What a data sheet says: wheels and mount, and that a camera gives identities. All else is a default."""
SEEN = ("scan_t", "obs_t")


def recordings(data: Path) -> list[str]:
    """Names of the sets in a folder that hold scans or sightings and a description, in their order by name."""
    return [path.parent.name for path in sorted(data.glob("*/*.npz")) if _holds_sights(path)]


def archive_of(data: Path, name: str) -> Archive:
    """A set, kept in memory until another is asked for. Raises DataSetError."""
    return _loaded(data / name)


def stands_still(archive: Archive) -> bool:
    """Whether its sensor stood still: then it has no odometry."""
    return not {"odom_t", "scan_odom_pose"} & archive.arrays.keys()


def prepared(archive: Archive, own: bool) -> tuple[Archive, Configuration]:
    """The archive with its latency, and its own file's configuration or the defaults with its geometry.

    A set without a file takes the one for its kind of odometry. Raises ConfigurationError, DataSetError.
    """
    try:
        path = configuration_path(archive)
    except DataSetError:
        path = CONFIG / NEAREST[motion_model(archive)]
    configuration, _ = configured(archive, path)
    if not own:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
        known = [leaf for key in GEOMETRY for leaf in _leaves(key, _at(tree, key))]
        known += _leaves("slam.mount", configuration.slam.mount.model_dump())
        overrides = {key: json.dumps(value) for key, value in known}
        configuration = load_configuration_text('rover = "defaults"\n', overrides, "defaults", recorded=False)
    latency_s = (configuration.data_set or DataSetSettings()).laser_latency_s
    return replace(archive, laser_latency_s=latency_s), configuration


@lru_cache(maxsize=1)
def _loaded(folder: Path) -> Archive:
    return load_archive(folder)


def _holds_sights(path: Path) -> bool:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return "meta" in archive.files and any(name in archive.files for name in SEEN)
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def _at(tree: dict[str, Any], key: str) -> Any:
    value: Any = tree
    for name in key.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _leaves(key: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        return [leaf for name, inner in value.items() for leaf in _leaves(f"{key}.{name}", inner)]
    return [] if value is None else [(key, value)]
