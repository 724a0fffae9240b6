"""The paths that a run holds: estimate, odometry and truth, read back from its record."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.errors import UsageError
from runtime.messages.decoding import decoded
from runtime.messages.estimate import decode_poses
from runtime.messages.tick import decode_defect, decode_truth
from runtime.record.reader import RunReader
from slam.pose import Pose2

Row = tuple[float, float, float, float]
SEARCHING = ("maps_known", "recognised_is_new")  # counts of an estimate that tell when its place was found
HOLDING_POSES = frozenset(("/tick", "/estimate", "/truth", "/defect"))


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """Rows (n, 4) of t s, x m, y m, heading rad.

    estimated: the published pose; particles: the mean of the particles' own; odometry: dead reckoning alone;
    simulated: the simulator's truth, None without one. defects: why steps raised, one reason for each that did.
    searched: how many poses are left out because the place in the saved map was not known yet.
    """

    estimated: FloatArray
    particles: FloatArray
    odometry: FloatArray
    simulated: FloatArray | None
    defects: tuple[str, ...] = ()
    searched: int = 0


def with_estimates(run: RunReader) -> RunReader:
    """The run itself, or its newest replay where it was imported. Raises NotARunError, UsageError (no replay yet)."""
    if not run.header.is_import:
        return run
    path, newest = run.folder.path, run.folder.newest_replay()
    if newest is None:
        raise UsageError(
            f"{path} was imported and has no estimates yet; create them with: infant replay {path} (or give "
            "the folder that a replay was written to with --out)"
        )
    return RunReader(newest.path)


def read_trajectories(reader: RunReader) -> Trajectories:
    """Only poses are kept. Raises UsageError when the run holds no estimate."""
    columns: tuple[list[Row], ...] = ([], [], [])
    simulated: list[Row] = []
    defects: list[str] = []
    counts: list[list[float]] = []
    for record in reader.records(HOLDING_POSES):
        if record.topic == "/estimate":
            poses, figures = decoded(record, decode_poses, reader.place)
            for column, pose in zip(columns, poses, strict=True):
                column.append(_row(record.stamp_ns, pose))
            counts.append([figures.get(name, math.nan) for name in SEARCHING])
        elif record.topic == "/truth":
            simulated.append(_row(record.stamp_ns, decoded(record, decode_truth, reader.place)))
        elif record.topic == "/defect":
            defects.append(decoded(record, decode_defect, reader.place))
    if not columns[0]:
        raise UsageError(f"{reader.folder.path} holds no estimates; replay it first")
    searched = searched_rows(dict(zip(SEARCHING, np.array(counts).T, strict=True)))
    estimated, particles, odometry = (np.array(column)[searched:] for column in columns)
    truth = np.array(simulated) if simulated else None
    return Trajectories(estimated, particles, odometry, truth, tuple(defects), searched)


def searched_rows(counts: Mapping[str, FloatArray]) -> int:
    """How many poses of a run that began anywhere in a saved map came before its place there was known.

    counts: a value a tick (n,), NaN where there is none. 0 where the place was known at once, and where it never was.
    """
    recognised = np.flatnonzero(counts.get(SEARCHING[1], np.empty(0)) == 0.0)
    return int(recognised[0]) if len(recognised) and begins_searching(counts) else 0


def begins_searching(counts: Mapping[str, FloatArray]) -> bool:
    """Whether the run had a saved map and no place in it when it began."""
    known = counts.get(SEARCHING[0], np.empty(0))
    known = known[np.isfinite(known)]
    return bool(len(known) and known[0] >= 2.0)


def _row(stamp_ns: int, pose: Pose2) -> Row:
    return stamp_ns * 1e-9, pose.x_m, pose.y_m, pose.heading_rad
