"""How far the estimates of a run are from what is known of the truth."""

from pathlib import Path
from typing import Any

import numpy as np

from drivers.measurements import FloatArray
from runtime.evaluate.errors import LEAST_FIT_POINTS, PositionError, position_error, rigid_fit
from runtime.evaluate.rows import nearest_rows, poses_at, read_tum, relative_poses, tum_text
from runtime.evaluate.truth import DataSetTruth
from runtime.record.reader import RunReader
from runtime.record.trajectories import Trajectories, read_trajectories, with_estimates
from runtime.settings.configuration import load_configuration_text
from slam.pose import composed, wrap_rads

PAIRING_S = 0.05  # data README: relation times are paired within this
NO_OFFSET = (0.0, 0.0, 0.0)


def evaluate(run: Path, truth: Path | None = None) -> dict[str, Any]:
    """Figures of a run's estimates; those of the newest replay inside it if the run was imported.

    truth: a TUM file to compare with instead of what the run itself holds. Keys as --json prints them; a figure for
    which there is no truth is None. Also writes RUN/trajectory.tum. Raises NotARunError, UsageError,
    ConfigurationError, StorageError.
    """
    reader = RunReader(run)
    folder = reader.folder
    estimates = with_estimates(reader)
    trajectories = read_trajectories(estimates)
    folder.write(folder.trajectory_path, tum_text(trajectories.estimated))
    configuration = load_configuration_text(estimates.header.configuration_text)
    mount = configuration.slam.mount
    figures = nothing_known()
    if truth is not None:
        figures |= against_points(trajectories, read_tum(truth), NO_OFFSET) | {"truth": f"poses of {truth.name}"}
    elif trajectories.simulated is not None:
        figures |= against_simulation(trajectories)
    else:
        held = DataSetTruth.from_attachments(reader.attachments)
        if held is not None:
            figures |= against_data_set(trajectories, held, (mount.x_m, mount.y_m, mount.yaw_rad))
    return {
        "run": str(run),
        "estimates": str(estimates.folder.path),
        "poses": len(trajectories.estimated),
        **figures,
        "trajectory": str(folder.trajectory_path),
        "truncated": estimates.truncated or None,
    }


def evaluation_lines(figures: dict[str, Any]) -> list[str]:
    """The figures for a person."""
    lines = [f"estimates {figures['estimates']}, {figures['poses']} poses", f"truth     {figures['truth']}"]
    if figures["rms_m"] is not None:
        lines.append(
            f"position  RMS {figures['rms_m']:.3f} m, 95 %-trimmed {figures['trimmed_rms_m']:.3f} m, largest "
            f"{figures['max_m']:.3f} m over {figures['n']} ({figures['frame']})"
        )
    if figures["aligned_rms_m"] is not None:
        lines.append(f"          RMS {figures['aligned_rms_m']:.3f} m after the best rigid fit")
    if figures["odometry_rms_m"] is not None:
        lines.append(
            f"          RMS {figures['particles_rms_m']:.3f} m for the particles' own mean (trimmed "
            f"{figures['particles_trimmed_rms_m']:.3f}), {figures['odometry_rms_m']:.3f} m for odometry alone"
        )
    if figures["relation_translation_m"] is not None:
        lines.append(
            f"relations {figures['relation_translation_m']:.3f} m, {figures['relation_rotation_deg']:.2f} deg on "
            f"average over {figures['relations']}; odometry alone {figures['odometry_relation_translation_m']:.3f} m, "
            f"{figures['odometry_relation_rotation_deg']:.2f} deg"
        )
    lines.append(f"for evo   {figures['trajectory']}")
    if figures["truncated"]:
        lines.append(f"note      {figures['truncated']}")
    return lines


def nothing_known() -> dict[str, Any]:
    """Every figure, none of them known."""
    names = (
        *("frame", "n", "rms_m", "trimmed_rms_m", "max_m", "aligned_rms_m", "odometry_rms_m"),
        *("particles_rms_m", "particles_trimmed_rms_m"),
        *("relations", "relation_translation_m", "relation_translation_std_m"),
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
    places_m = truth[known, 1:3]
    return {
        "truth": "simulator",
        "frame": "frame of the start pose",
        **_position_figures(position_error(estimated[known], places_m), int(known.sum())),
        "aligned_rms_m": _fitted(estimated[known], places_m).rms_m,
        **_comparison(position_error(particles[known], places_m), position_error(odometry[known], places_m)),
    }


def against_data_set(
    trajectories: Trajectories, truth: DataSetTruth, body_from_laser: tuple[float, float, float]
) -> dict[str, Any]:
    """Whatever the set has: fixes or poses for the position, relations for the shape."""
    figures: dict[str, Any] = {}
    if truth.fixes is not None:
        figures |= against_points(trajectories, truth.fixes, body_from_laser) | {"truth": "GPS, good fixes"}
    elif truth.poses is not None:
        figures |= against_points(trajectories, truth.poses, body_from_laser) | {"truth": truth.pose_kind}
    if truth.relations is not None:
        figures |= against_relations(at_laser(trajectories.estimated, body_from_laser), truth.relations)
        alone = against_relations(at_laser(trajectories.odometry, body_from_laser), truth.relations)
        figures["odometry_relation_translation_m"] = alone["relation_translation_m"]
        figures["odometry_relation_rotation_deg"] = alone["relation_rotation_deg"]
    return figures


def at_laser(rows: FloatArray, body_from_laser: tuple[float, float, float]) -> FloatArray:
    """Rows (n, 4) of t s, x m, y m, heading rad of the laser instead of the body."""
    laser = composed(rows[:, 1:], np.array(body_from_laser))
    return np.column_stack((rows[:, 0], laser[:, :2], wrap_rads(laser[:, 2])))


def against_points(
    trajectories: Trajectories, places: FloatArray, offset: tuple[float, float, float]
) -> dict[str, Any]:
    """Rows of t s, x m, y m in a frame of their own: a point fixed to the body, fitted rigidly.

    offset: where that point is; the antenna of a GPS stands beside the laser.
    """
    times_s, places_m = places[:, 0], places[:, 1:3]
    estimated, particles, odometry = (
        composed(poses_at(rows, times_s), np.array(offset))[:, :2]
        for rows in (trajectories.estimated, trajectories.particles, trajectories.odometry)
    )
    known = np.isfinite(estimated[:, 0])
    if known.sum() < LEAST_FIT_POINTS:
        return {"n": int(known.sum())}
    return {
        "frame": "rigid fit of the path" if offset == NO_OFFSET else "rigid fit of the laser point",
        **_position_figures(_fitted(estimated[known], places_m[known]), int(known.sum())),
        **_comparison(_fitted(particles[known], places_m[known]), _fitted(odometry[known], places_m[known])),
    }


def against_relations(estimated: FloatArray, relations: FloatArray) -> dict[str, Any]:
    """Mean and standard deviation of (true relation)^-1 (estimated relation) (Kuemmerle et al. 2009)."""
    first = nearest_rows(estimated, relations[:, 0], PAIRING_S)
    second = nearest_rows(estimated, relations[:, 1], PAIRING_S)
    paired = (first >= 0) & (second >= 0)
    if not paired.any():
        return {"relations": 0}
    between = relative_poses(estimated[first[paired], 1:], estimated[second[paired], 1:])
    error = relative_poses(relations[paired, 2:5], between)
    metres, degrees = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
    return {
        "relations": int(paired.sum()),
        "relation_translation_m": float(metres.mean()),
        "relation_translation_std_m": float(metres.std()),
        "relation_rotation_deg": float(degrees.mean()),
        "relation_rotation_std_deg": float(degrees.std()),
    }


def _fitted(points_m: FloatArray, onto_m: FloatArray) -> PositionError:
    """Error after the rigid motion that fits all points best; outliers leave only the trimmed figure."""
    return position_error(rigid_fit(points_m, onto_m).transform(points_m), onto_m)


def _position_figures(error: PositionError, count: int) -> dict[str, Any]:
    return {"n": count, "rms_m": error.rms_m, "trimmed_rms_m": error.trimmed_rms_m, "max_m": error.largest_m}


def _comparison(particles: PositionError, odometry: PositionError) -> dict[str, Any]:
    return {
        "particles_rms_m": particles.rms_m,
        "particles_trimmed_rms_m": particles.trimmed_rms_m,
        "odometry_rms_m": odometry.rms_m,
    }
