"""A drive in which the rover is carried once, without its wheels knowing: is the path one again, and how soon?"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.measurements import FloatArray
from runtime.evaluate.errors import position_error, rigid_fit
from runtime.evaluate.rows import poses_at
from runtime.importers.truth import truth_of
from runtime.studies.jobs import Result
from runtime.studies.places.recordings import archive_of, prepared
from runtime.studies.relocalisation.rover import StudiedRover
from runtime.studies.relocalisation.told_drives import recorded
from slam.pose import Pose2, composed, rotated

EARLIEST, LATEST = 0.15, 0.88  # of the drive
LEAST_M, LARGEST_M = 5.0, 80.0
GPS_SIGMA_M = 0.5


def slip_trial(
    data: str,
    name: str,
    seed: int | None,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """One slip drawn from the seed, or none. joined_m: way from the slip to the first recognition after it; false:
    recognitions before it. trimmed_m, nees_median (2 dof, with that of the fixes): against the fixes after a rigid fit;
    after_m: median error from the recognition on. Raises ValueError where there are no fixes.
    """
    drive = recorded(data, name, ())
    archive, configuration = prepared(archive_of(Path(data), name), own=True)
    truth = truth_of(archive)
    if truth is None or truth.fixes is None:
        raise ValueError(f"{name} has no fixes to compare with")
    at, slip = drawn_slip(seed, len(drive.seen))
    rover, rows, covariances = StudiedRover(drive.settings), [], []
    early, joined = 0, None
    for number, seen in enumerate(drive.seen):
        if number == at:
            told = slip @ Pose2(*seen.increment_mean.tolist())
            seen = replace(seen, increment_mean=told.as_array())
        found = rover.step(seen)
        if found is not None and not found.is_new:
            early += number < at
            joined = number if joined is None and number >= at else joined
        rows.append((seen.stamp_ns * 1e-9, *rover.pose.as_array().tolist()))
        covariances.append(rover.covariance[:2, :2].copy())
    mount = configuration.slam.mount
    laser, away = Pose2(mount.x_m, mount.y_m), slice(at, joined)
    figures = against_fixes(np.array(rows), np.array(covariances), truth.fixes, laser, away)
    way_m = None if joined is None else round(drive.driven_m(at, joined), 1)
    return {"seed": seed, "at": at, "slip_m": round(math.hypot(slip.x_m, slip.y_m), 1), "joined_m": way_m} | {
        "early": int(early),
        **figures,
    }


def drawn_slip(seed: int | None, scans: int) -> tuple[int, Pose2]:
    """The scan before which the rover is carried, and what its wheels do not know of; after the last one for None."""
    if seed is None:
        return scans, Pose2()
    generator = np.random.default_rng(seed)
    at = int(generator.uniform(EARLIEST, LATEST) * scans)
    far_m, direction, turned = generator.uniform((LEAST_M, -math.pi, -math.pi), (LARGEST_M, math.pi, math.pi))
    return at, Pose2(far_m * math.cos(direction), far_m * math.sin(direction), turned)


def against_fixes(
    path: FloatArray, covariances: FloatArray, fixes: FloatArray, body_from_laser: Pose2, away: slice
) -> Result:
    """path (n, 4) of t s, x m, y m, heading rad with covariances (n, 2, 2); fixes (g, 3) of t s, x m, y m.

    away: the scans from the slip to the recognition, without which the path is fitted: 70 m off for a while, they would
    turn all of it.
    """
    points = composed(poses_at(path, fixes[:, 0]), body_from_laser.as_array())[:, :2]
    known = np.isfinite(points[:, 0])
    scans = np.searchsorted(path[:, 0], fixes[:, 0])
    kept = known & ~np.isin(scans, np.arange(len(path))[away])
    fit = rigid_fit(points[kept], fixes[kept, 1:3])
    fitted, places, stamps_s = fit.transform(points[known]), fixes[known, 1:3], fixes[known, 0]
    off = fitted - places
    turned = rotated(np.eye(2), fit.heading_rad).T
    nearest = np.clip(np.searchsorted(path[:, 0], stamps_s), 0, len(path) - 1)
    spread = turned @ covariances[nearest] @ turned.T + GPS_SIGMA_M**2 * np.eye(2)
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    errors = np.hypot(*off.T)
    after = errors[scans[known] >= away.stop] if away.stop is not None else np.zeros(0)
    return {
        "trimmed_m": round(position_error(fitted, places).trimmed_rms_m, 3),
        "after_m": round(float(np.median(after)), 3) if len(after) else None,
        "nees_median": round(float(np.median(squares)), 2),
    }
