"""The map that a run begins in: chosen on the command line, kept beside the record, and found again by a replay."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.measurements import Event
from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError, NotAMapError, UsageError
from runtime.map_files.fitness import distance_outside, suits, too_small
from runtime.map_files.map_file import SavedMap, decode_map
from runtime.map_files.map_store import read_map
from runtime.map_files.origin import MapOrigin
from runtime.printable import printable
from runtime.record.folder import LARGEST_MAP_BYTES, RunFolder
from runtime.record.header import RunHeader
from runtime.settings.configuration import Configuration
from slam.maps.start import MapStart, first_maps
from slam.pose import Pose2
from slam.settings.slam import SlamSettings

MOST_SPREAD_M = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class RunStart:
    """A saved map with the bytes of its file, and how the run begins in it.

    pose: map_from_body at the first scan, None where the rover has to recognise its place. notes: what differs between
    the rover of the map and this one.
    """

    path: Path
    saved: SavedMap
    data: bytes
    localise_only: bool
    pose: Pose2 | None
    notes: tuple[str, ...] = ()

    @property
    def metadata(self) -> dict[str, str]:
        """For the header of the run; the map itself lies beside the record."""
        return {
            "file": self.path.name,
            "sha256": self.saved.sha256,
            "localise_only": str(self.localise_only),
            "start_at": "" if self.pose is None else ",".join(map(repr, self.pose.as_array().tolist())),
        }

    def event(self, stamp_ns: int) -> Event:
        """That the run begins in a map, for its first tick."""
        how = "it is never altered" if self.localise_only else "what the run adds goes into a new map"
        where = "a place that it has yet to recognise"
        if self.pose is not None:
            where = "{:.2f} m, {:.2f} m, {:.3f} rad".format(*self.pose.as_array())
        reason = f"the run starts in {self.path.name} ({len(self.saved.joint)} landmarks) at {where}; {how}"
        return Event(stamp_ns, "map", "begun", reason)

    def keep_in(self, folder: RunFolder) -> None:
        """Copy the map beside the record, without which no replay could begin. Raises StorageError."""
        folder.write(folder.start_map_path, self.data)


def for_estimator(start: RunStart | None) -> MapStart | None:
    """What the filter has to know of it."""
    return None if start is None else MapStart(start.saved.joint, start.localise_only, start.pose)


def choose_start(
    file: Path | None, localise_only: bool, start_at: str | None, configuration: Configuration
) -> RunStart | None:
    """What the command line says, or the configuration's map.file; None where a run begins without a map.

    Raises UsageError, NotAMapError, and ConfigurationError where the map is another sensor's.
    """
    path = file if file is not None else None if configuration.map.file is None else Path(configuration.map.file)
    if path is None:
        if localise_only or start_at is not None:
            raise UsageError("--localise-only and --start-at need a map: give --map MAP or set map.file")
        return None
    saved, data = read_map(path)
    fitness = suits(saved, str(path), configuration)
    if fitness.refusal:
        raise ConfigurationError(fitness.refusal)
    if start_at is None:
        if small := too_small(saved.joint):
            raise UsageError(f"{path} holds {small}; give --start-at X,Y,YAW, or save a map of a longer drive")
        return RunStart(path, saved, data, localise_only, None, fitness.notes)
    pose = parse_pose(start_at)
    _check_certainty(saved, pose, str(path))
    outside_m = distance_outside(saved, pose)
    reach_m = configuration.slam.view.range_max_m
    if outside_m > reach_m:
        low, high = saved.joint.means_m.min(axis=0), saved.joint.means_m.max(axis=0)
        raise UsageError(
            f"--start-at {start_at} is {outside_m:.0f} m from the nearest landmark of {path}, whose landmarks lie at "
            f"x {low[0]:.0f} to {high[0]:.0f} m and y {low[1]:.0f} to {high[1]:.0f} m: no sensor reaches that far"
        )
    return RunStart(path, saved, data, localise_only, pose, fitness.notes)


def _check_certainty(saved: SavedMap, pose: Pose2, name: str) -> None:
    """Raises NotAMapError where the landmarks around a pose leave open where that is: the filter cannot begin there."""
    try:
        joint, _ = first_maps(SlamSettings(), MapStart(saved.joint, True, pose))
        variance_m2 = float(np.trace(joint.state.covariance[:2, :2]))
    except (ArithmeticError, ValueError):  # numpy's, of covariances that are none
        variance_m2 = math.nan
    if not 0.0 <= variance_m2 < MOST_SPREAD_M**2:
        raise NotAMapError(
            f"{name} does not say how accurately its landmarks around {pose} are known; take another copy of the map"
        )


@dataclass(frozen=True, slots=True)
class BeginIn:
    """Words of the command line for a replay: file None means the map that the run was recorded with, if any."""

    file: Path | None = None
    localise_only: bool = False
    start_at: str | None = None

    def start(self, header: RunHeader, folder: RunFolder, configuration: Configuration) -> RunStart | None:
        """Raises UsageError, NotAMapError, ConfigurationError."""
        if self.file is None and (self.localise_only or self.start_at is not None):
            raise UsageError("--localise-only and --start-at need a map: give --map MAP")
        if self.file is None:
            return recorded_start(header, folder)
        return choose_start(self.file, self.localise_only, self.start_at, configuration)


AS_RECORDED = BeginIn()


def parse_pose(text: str) -> Pose2:
    """X,Y,YAW in metres and radians. Raises UsageError."""
    try:
        x_m, y_m, yaw_rad = (float(word) for word in text.split(","))
    except ValueError as error:
        raise UsageError(
            f"--start-at {text}: expected X,Y,YAW in metres and radians, for example 3.5,-2,1.57"
        ) from error
    if not all(abs(value) < 1e7 for value in (x_m, y_m, yaw_rad)):
        raise UsageError(f"--start-at {text}: expected finite numbers, X and Y in metres, YAW in radians")
    return Pose2() @ Pose2(x_m, y_m, yaw_rad)


def recorded_start(header: RunHeader, folder: RunFolder) -> RunStart | None:
    """How a recorded run began; None where it began without a map.

    Raises NotAMapError where the copy of its map is gone or is another one, or the run does not say how it began.
    """
    if not header.start:
        return None
    path = folder.start_map_path
    try:
        data = read_bounded(path, LARGEST_MAP_BYTES)
    except OSError as error:
        raise NotAMapError(
            f"{path} cannot be read ({error.strerror}); the run started in this map and cannot be replayed without it"
        ) from error
    if hashlib.sha256(data).hexdigest() != header.start.get("sha256"):
        raise NotAMapError(f"{path} is not the map in which the run started; take another copy of the run")
    try:
        return _from_metadata(header.start, data, path)
    except (KeyError, UsageError) as error:
        why = printable(str(error), 200)
        raise NotAMapError(
            f"{folder.path} does not say how it started in its map ({why}); take another copy"
        ) from error


def origin_of(header: RunHeader, folder: RunFolder) -> MapOrigin | None:
    """Where on earth the map of a run lies, where it began in a saved one that knows."""
    try:
        start = recorded_start(header, folder)
    except NotAMapError:  # without its map nobody knows; a replay says that it is gone
        return None
    return None if start is None else start.saved.facts.origin


def _from_metadata(facts: Mapping[str, str], data: bytes, path: Path) -> RunStart:
    saved = decode_map(data, str(path))
    pose = parse_pose(facts["start_at"]) if facts["start_at"] else None
    if pose is not None:
        _check_certainty(saved, pose, str(path))
    return RunStart(Path(facts["file"]), saved, data, facts["localise_only"] == "True", pose)
