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
from runtime.importers.data_set import configuration_path
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.settings.data_set import DataSetSettings
from runtime.source_tree import CONFIG

GEOMETRY = ("vehicle", "slam.mount", "slam.front_end.kind", "slam.association.strategy")
"""What a data sheet says: wheels and mount, and that a camera gives identities. All else is a default."""
NEAREST = CONFIG / "carmen.toml"  # of a set whose odometry comes as poses and that has no file of its own
SEEN = ("scan_t", "obs_t")


def recordings(data: Path) -> list[str]:
    """Names of the sets in a folder that hold scans or sightings and a description, in their order by name."""
    return [path.parent.name for path in sorted(data.glob("*/*.npz")) if _holds_sights(path)]


def archive_of(data: Path, name: str) -> Archive:
    """A set, kept in memory until another is asked for. Raises DataSetError."""
    return _loaded(data / name)


def stands_still(archive: Archive) -> bool:
    """Whether its sensor stood still: then it has no odometry."""
    return "odom_t" not in archive


def configured(archive: Archive, own: bool) -> tuple[Archive, Configuration]:
    """The archive with its latency, and its own file's configuration or the defaults with its geometry.

    The mount of the set's description counts where the file says nothing of it. Raises ConfigurationError.
    """
    try:
        path = configuration_path(archive)
    except DataSetError:
        path = NEAREST
    tree = tomllib.loads(path.read_text(encoding="utf-8"))
    described = {**archive.meta.get("geometry", {}), **archive.meta.get("vehicle", {})}
    overrides = {}
    if "laser_x" in described and _at(tree, "slam.mount") is None:
        overrides["slam.mount.x_m"] = json.dumps(described["laser_x"])
    if own:
        configuration = load_configuration(path, overrides)
    else:
        for key in GEOMETRY:
            overrides |= {name: json.dumps(value) for name, value in _leaves(key, _at(tree, key))}
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
