"""The paths that a run holds: estimate, odometry and truth, read back from its record."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """Rows (n, 4) of t s, x m, y m, heading rad.

    estimated: the published pose; particles: the mean of the particles' own; odometry: dead reckoning alone;
    simulated: the simulator's truth, None without one. defects: why steps raised, one reason for each that did.
    """

    estimated: FloatArray
    particles: FloatArray
    odometry: FloatArray
    simulated: FloatArray | None
    defects: tuple[str, ...] = ()


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
    for record in reader.records():
        if record.topic == "/estimate":
            for column, pose in zip(columns, decoded(record, decode_poses, reader.place), strict=True):
                column.append(_row(record.stamp_ns, pose))
        elif record.topic == "/truth":
            simulated.append(_row(record.stamp_ns, decoded(record, decode_truth, reader.place)))
        elif record.topic == "/defect":
            defects.append(decoded(record, decode_defect, reader.place))
    if not columns[0]:
        raise UsageError(f"{reader.folder.path} holds no estimates; replay it first")
    estimated, particles, odometry = (np.array(column) for column in columns)
    return Trajectories(estimated, particles, odometry, np.array(simulated) if simulated else None, tuple(defects))


def _row(stamp_ns: int, pose: Pose2) -> Row:
    return stamp_ns * 1e-9, pose.x_m, pose.y_m, pose.heading_rad
