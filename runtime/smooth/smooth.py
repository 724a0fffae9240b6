"""infant smooth: the path and the landmarks of a run as everything that it saw has them, in files beside the run."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray, IntArray
from runtime.evaluate.errors import LEAST_FIT_POINTS, position_error, rigid_fit
from runtime.evaluate.rows import tum_text
from runtime.evaluate.smoothed import SMOOTHED, SmoothedResult, smoothed_json_path
from runtime.optional_packages import needs
from runtime.record.reader import RunReader
from runtime.record.trajectories import with_estimates
from runtime.settings.configuration import load_configuration_text
from runtime.smooth.contradictions import doubled, partings, wrong_matches
from runtime.smooth.sightings import DriveTold, read_told
from runtime.smooth.solve import SmoothedDrive, smooth_drive
from slam.pose import composed, inverted, wrap_rads

MOST_COVARIANCES = 500  # of poses, evenly over the run: each takes some milliseconds

Progress = Callable[[float], None]


def smooth_run(run: Path, progress: Progress) -> dict[str, Any]:
    """The command: replay, smooth, compare, write, and return its summary.

    Raises UsageError (no gtsam, nothing to smooth by), NotARunError, NotAMapError, ConfigurationError, StorageError.
    """
    with needs("gtsam", "infant smooth"):
        import gtsam  # noqa: F401 before the work and not only after it
    began_s = time.monotonic()
    reader = RunReader(run)
    estimates = with_estimates(reader)
    text = estimates.header.configuration_text
    configuration = load_configuration_text(text, source=f"configuration of {run}")
    told = read_told(estimates, configuration, progress)
    replayed_s = time.monotonic()
    drive = smooth_drive(told)
    covariances = drive.solution.covariances()
    sampled = np.unique(np.linspace(0, len(told.stamps_s) - 1, MOST_COVARIANCES).round().astype(np.int64))
    poses, mount = drive.solution.poses, told.body_from_laser
    spreads = np.array([covariances.pose(number, poses[number], mount) for number in sampled.tolist()])
    places = np.array([covariances.landmark(number) for number in range(len(drive.solution.landmarks))])
    result = SmoothedResult(
        estimates=estimates.folder.path.resolve().name,
        configuration_sha256=configuration.sha256,
        scans=len(poses),
        landmarks=len(drive.solution.landmarks),
        sightings=len(drive.used.scans),
        refuted=int(drive.refuted.sum()),
        noise={name: round(getattr(drive.noise, name), 4) for name in ("ranges", "bearings", "motions")},
        apart_rms_m=_apart_rms_m(told, poses),
        wrong_matches=wrong_matches(told, drive),
        doubled=doubled(told, drive, covariances),
        partings=partings(told, poses, sampled, spreads),
    )
    folder = reader.folder
    files = {
        folder.tum_path(SMOOTHED): tum_text(at_ticks(told, poses)),
        folder.path / "smoothed_landmarks.csv": _landmark_table(drive, places),
        folder.path / "smoothed_covariances.csv": _pose_table(told, poses, sampled, spreads),
        smoothed_json_path(folder): result.model_dump_json(indent=1) + "\n",
    }
    for path, content in files.items():
        folder.write(path, content)
    return {
        "run": str(run),
        **result.model_dump(),
        "files": [str(path) for path in files],
        "replay_s": round(replayed_s - began_s, 2),
        "smooth_s": round(time.monotonic() - replayed_s, 2),
        "truncated": estimates.truncated or None,
    }


def at_ticks(told: DriveTold, poses: FloatArray) -> FloatArray:
    """Rows (t, 4) of the path at every tick from the first scan on: between scans by odometry, what that is off by at
    the next scan shared out over time.
    """
    ticks, stamps_s = told.ticks, told.stamps_s
    ticks = ticks[ticks[:, 0] >= stamps_s[0]]
    before = np.searchsorted(stamps_s, ticks[:, 0], side="right") - 1
    after = np.minimum(before + 1, len(stamps_s) - 1)
    by_odometry = composed(poses[before], composed(inverted(told.odometry[before]), ticks[:, 1:]))
    reached = composed(poses[before], composed(inverted(told.odometry[before]), told.odometry[after]))
    off = poses[after] - reached
    off[:, 2] = wrap_rads(off[:, 2])
    off[after == before] = 0.0
    lasts_s = np.where(after > before, stamps_s[after] - stamps_s[before], 1.0)
    share = np.clip((ticks[:, 0] - stamps_s[before]) / lasts_s, 0.0, 1.0)
    rows = by_odometry + share[:, None] * off
    rows[:, 2] = wrap_rads(rows[:, 2])
    return np.column_stack((ticks[:, 0], rows))


def smooth_lines(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    noise = summary["noise"]
    lines = [
        f"smoothed  {summary['scans']} scans, {summary['landmarks']} landmarks, {summary['sightings']} sightings",
        f"noise     ranges {noise['ranges']:.2f}, bearings {noise['bearings']:.2f}, motions {noise['motions']:.2f} "
        "times what is configured",
        f"rejected  {summary['refuted']} sightings, {len(summary['wrong_matches'])} wrong matches; "
        f"{len(summary['doubled'])} pairs of landmarks are probably one object each",
    ]
    if summary["apart_rms_m"] is not None:
        lines.append(
            f"filter    {summary['apart_rms_m']:.3f} m RMS from the smoothed path after the best fit; "
            f"{len(summary['partings'])} times more than three sigma apart"
        )
    if summary["truncated"]:
        lines.append(f"note      {summary['truncated']}")
    lines.append(f"time      {summary['replay_s']:.1f} s for the replay, {summary['smooth_s']:.1f} s for smoothing")
    return [*lines, f"files     {', '.join(summary['files'])}"]


def _apart_rms_m(told: DriveTold, poses: FloatArray) -> float | None:
    """After the best rigid fit: both begin at one pose, whose heading the whole run knows better."""
    filtered, smoothed = told.filtered[told.known, :2], poses[told.known, :2]
    if len(filtered) < LEAST_FIT_POINTS:
        return None
    return round(position_error(rigid_fit(filtered, smoothed).transform(filtered), smoothed).rms_m, 6)


def _landmark_table(drive: SmoothedDrive, covariances: FloatArray) -> str:
    """Sightings: used, and those of them that were refuted."""
    solution, used = drive.solution, drive.used
    lines = ["identity,x_m,y_m,xx_m2,xy_m2,yy_m2,sightings,refuted"]
    for identity, (x, y), spread in zip(
        solution.identities.tolist(), solution.landmarks.tolist(), covariances, strict=True
    ):
        own = used.identities == identity
        figures = f"{x:.6f},{y:.6f},{spread[0, 0]:.9f},{spread[0, 1]:.9f},{spread[1, 1]:.9f}"
        lines.append(f"{identity},{figures},{int(own.sum())},{int((own & drive.refuted).sum())}")
    return "\n".join(lines) + "\n"


def _pose_table(told: DriveTold, poses: FloatArray, sampled: IntArray, spreads: FloatArray) -> str:
    """h: heading in rad."""
    lines = ["t_s,x_m,y_m,h_rad,xx,xy,xh,yy,yh,hh"]
    upper = np.triu_indices(3)
    for number, spread in zip(sampled.tolist(), spreads, strict=True):
        figures = ",".join(f"{value:.9f}" for value in (*poses[number], *spread[upper]))
        lines.append(f"{told.stamps_s[number]:.9f},{figures}")
    return "\n".join(lines) + "\n"
