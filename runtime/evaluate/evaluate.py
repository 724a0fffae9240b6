"""How far the estimates of a run are from what is known of the truth."""

from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.errors import UsageError
from runtime.evaluate.against_truth import fitted_error, path_error
from runtime.evaluate.errors import PositionError, position_error
from runtime.evaluate.rows import poses_at, read_tum, tum_text
from runtime.evaluate.smoothed import against_smoothed, smoothed_lines
from runtime.evaluate.truth import NO_OFFSET, DataSetTruth, Mount
from runtime.fault_isolation import defects_line
from runtime.record.reader import RunReader
from runtime.record.trajectories import Trajectories, read_trajectories, with_estimates
from runtime.settings.configuration import load_configuration_text

TUM_FILES = {"trajectory": "trajectory", "odometry_trajectory": "odometry", "truth_trajectory": "truth"}


def evaluate(run: Path, truth: Path | None = None) -> dict[str, Any]:
    """Figures of a run's estimates; those of the newest replay inside it if the run was imported.

    truth: a TUM file to compare with instead of what the run itself holds. Keys as --json prints them; a figure for
    which there is no truth is None. Estimates are interpolated to the times of the truth; `n` of `n_known` places and
    `relations` of `relations_known` were reached. Also writes trajectory.tum, odometry.tum and, with truth,
    truth.tum into RUN: of the body, in seconds of the run's stamps. Raises NotARunError, UsageError,
    ConfigurationError, StorageError.
    """
    reader = RunReader(run)
    folder = reader.folder
    estimates = with_estimates(reader)
    trajectories = read_trajectories(estimates)
    mount = load_configuration_text(estimates.header.configuration_text).slam.mount
    body_from_laser = (mount.x_m, mount.y_m, mount.yaw_rad)
    held = DataSetTruth.from_attachments(reader.attachments)
    if truth is not None:
        rows = in_time_of_run(read_tum(truth), trajectories.estimated[:, 0], reader.header.wall_minus_monotonic_ns)
        held = DataSetTruth(poses=rows, pose_kind=f"poses of {truth.name}", of_body=True)
    figures = nothing_known()
    if truth is None and trajectories.simulated is not None:
        figures |= against_simulation(trajectories)
        held = DataSetTruth(poses=trajectories.simulated, of_body=True)
    elif held is not None:
        figures |= against_data_set(trajectories, held, body_from_laser)
    figures |= against_smoothed(folder, estimates.folder, held, body_from_laser)
    written = {"trajectory": trajectories.estimated, "odometry": trajectories.odometry}
    if held is not None and (places := held.places_of_body(body_from_laser)) is not None:
        written["truth"] = places
    for name, rows in written.items():
        folder.write(folder.tum_path(name), tum_text(rows))
    return {
        "run": str(run),
        "estimates": str(estimates.folder.path),
        "poses": len(trajectories.estimated),
        "searched": trajectories.searched,
        "defects": len(trajectories.defects),
        "defect": next(iter(trajectories.defects), None),
        **figures,
        **{key: str(folder.tum_path(name)) if name in written else None for key, name in TUM_FILES.items()},
        "truncated": estimates.truncated or None,
    }


def in_time_of_run(rows: FloatArray, times_s: FloatArray, wall_minus_monotonic_ns: int | None) -> FloatArray:
    """Rows of t s, ... in the time of the run's stamps: as they are, or taken for seconds since 1970.

    Raises UsageError where neither meets the times (n,) of the run.
    """
    shifts_s = (0.0,) if wall_minus_monotonic_ns is None else (0.0, wall_minus_monotonic_ns * 1e-9)
    for shift_s in shifts_s:
        moved = np.column_stack((rows[:, 0] - shift_s, rows[:, 1:]))
        if ((moved[:, 0] >= times_s[0]) & (moved[:, 0] <= times_s[-1])).any():
            return moved
    raise UsageError(
        f"no stamp of the truth ({rows[0, 0]:.3f} to {rows[-1, 0]:.3f} s) is within the run "
        f"({times_s[0]:.3f} to {times_s[-1]:.3f} s); give the times of trajectory.tum, or seconds since 1970 "
        "if the run has a wall clock"
    )


def evaluation_lines(figures: dict[str, Any]) -> list[str]:
    """The figures for a person."""
    lines = [f"estimates {figures['estimates']}, {figures['poses']} poses", f"truth     {figures['truth']}"]
    if figures["defects"]:
        lines.append(defects_line(figures["defects"], figures["poses"], figures["defect"]))
    if figures["searched"]:
        lines.append(
            f"left out  {figures['searched']} poses before the place in the saved map was known: they are in another "
            "frame"
        )
    if figures["n_known"] is not None:
        lines.append(f"used      {figures['n']} of {figures['n_known']} positions of the truth")
    if figures["rms_m"] is not None:
        lines.append(
            f"position  RMS {figures['rms_m']:.3f} m, 95 %-trimmed {figures['trimmed_rms_m']:.3f} m, largest "
            f"{figures['max_m']:.3f} m ({figures['frame']})"
        )
    if figures["aligned_rms_m"] is not None:
        lines.append(f"          RMS {figures['aligned_rms_m']:.3f} m after the best rigid fit")
    if figures["odometry_rms_m"] is not None:
        lines.append(
            f"          RMS {figures['particles_rms_m']:.3f} m for the particles' own mean (trimmed "
            f"{figures['particles_trimmed_rms_m']:.3f}), {figures['odometry_rms_m']:.3f} m for odometry alone"
        )
    if figures["relations_known"] is not None:
        lines.append(f"used      {figures['relations']} of {figures['relations_known']} relations")
    if figures["relation_translation_m"] is not None:
        lines.append(
            f"relations {figures['relation_translation_m']:.3f} m, {figures['relation_rotation_deg']:.2f} deg on "
            f"average; odometry alone {figures['odometry_relation_translation_m']:.3f} m, "
            f"{figures['odometry_relation_rotation_deg']:.2f} deg"
        )
    lines += smoothed_lines(figures)
    lines.append(f"for evo   {', '.join(path for key in TUM_FILES if (path := figures[key]))}")
    if figures["truncated"]:
        lines.append(f"note      {figures['truncated']}")
    return lines


def nothing_known() -> dict[str, Any]:
    """Every figure, none of them known."""
    names = (
        *("frame", "n", "n_known", "rms_m", "trimmed_rms_m", "max_m", "aligned_rms_m", "odometry_rms_m"),
        *("particles_rms_m", "particles_trimmed_rms_m"),
        *("relations", "relations_known", "relation_translation_m", "relation_translation_std_m"),
        *("relation_rotation_deg", "relation_rotation_std_deg"),
        *("odometry_relation_translation_m", "odometry_relation_rotation_deg"),
    )
    return {"truth": "none: this recording has no truth", **dict.fromkeys(names)}


def against_simulation(trajectories: Trajectories) -> dict[str, Any]:
    """In the frame of the start pose, where the simulated map begins, and after a rigid fit of the whole path."""
    truth = trajectories.simulated
    assert truth is not None  # the caller has looked
    estimated, particles, odometry = (
        poses_at(rows, truth[:, 0])[:, :2]
        for rows in (trajectories.estimated, trajectories.particles, trajectories.odometry)
    )
    known = np.isfinite(estimated[:, 0])
    if not known.any():
        return {"truth": "simulator", "n": 0, "n_known": len(truth)}
    places_m = truth[known, 1:3]
    fitted, _ = fitted_error(trajectories.estimated, truth)
    return {
        "truth": "simulator",
        "frame": "frame of the start pose",
        "n": int(known.sum()),
        "n_known": len(truth),
        **_position_figures(position_error(estimated[known], places_m)),
        "aligned_rms_m": None if fitted is None else fitted.rms_m,
        **_comparison(position_error(particles[known], places_m), position_error(odometry[known], places_m)),
    }


def against_data_set(trajectories: Trajectories, truth: DataSetTruth, body_from_laser: Mount) -> dict[str, Any]:
    """Whatever the set has: fixes or poses for the position, relations for the shape."""
    estimated, particles, odometry = (
        path_error(rows, truth, body_from_laser)
        for rows in (trajectories.estimated, trajectories.particles, trajectories.odometry)
    )
    figures: dict[str, Any] = {}
    if estimated.positions_known:
        figures["truth"] = "GPS, good fixes" if truth.fixes is not None else truth.pose_kind
        figures |= {"n": estimated.positions_used, "n_known": estimated.positions_known}
    if estimated.position is not None and particles.position is not None and odometry.position is not None:
        figures["frame"] = f"rigid fit of the {'path' if truth.point(body_from_laser) == NO_OFFSET else 'laser point'}"
        figures |= _position_figures(estimated.position) | _comparison(particles.position, odometry.position)
    if estimated.relations_known:
        figures |= {"relations": estimated.relations_used, "relations_known": estimated.relations_known}
    if estimated.relation is not None and odometry.relation is not None:
        figures |= {
            "relation_translation_m": estimated.relation.translation_m,
            "relation_translation_std_m": estimated.relation.translation_std_m,
            "relation_rotation_deg": estimated.relation.rotation_deg,
            "relation_rotation_std_deg": estimated.relation.rotation_std_deg,
            "odometry_relation_translation_m": odometry.relation.translation_m,
            "odometry_relation_rotation_deg": odometry.relation.rotation_deg,
        }
    return figures


def _position_figures(error: PositionError) -> dict[str, Any]:
    return {"rms_m": error.rms_m, "trimmed_rms_m": error.trimmed_rms_m, "max_m": error.largest_m}


def _comparison(particles: PositionError, odometry: PositionError) -> dict[str, Any]:
    return {
        "particles_rms_m": particles.rms_m,
        "particles_trimmed_rms_m": particles.trimmed_rms_m,
        "odometry_rms_m": odometry.rms_m,
    }
