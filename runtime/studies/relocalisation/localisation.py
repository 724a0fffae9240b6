"""Localisation only in a world whose map an earlier drive has made: how exact is the pose, and does it say so?"""

import numpy as np

from runtime.evaluate.errors import squared_pose_errors
from runtime.studies.jobs import Result
from runtime.studies.paper.drives.worlds import WorldKind
from runtime.studies.relocalisation.kidnaps import distance_m
from runtime.studies.relocalisation.rover import StudiedRover
from runtime.studies.relocalisation.told_drives import told_world
from slam.maps.joint_map import JointMap
from slam.maps.start import MapStart
from slam.pose import Pose2

TOLD_OFF = Pose2(0.3, -0.4, 0.06)  # half a metre and 3.4 degrees


def localise_trial(
    kind: WorldKind,
    seed: int,
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """RMS m, largest error m and median NEES (3 dof) in the frame of the first drive; whether the map is as it was, and
    how many of its landmarks were gone in the end.
    """
    mapping, drive = told_world(kind, seed, 0), told_world(kind, seed, 1)
    rover = StudiedRover(mapping.settings)
    for seen in mapping.seen:
        rover.step(seen)
    known = rover.saved()
    rover = StudiedRover(drive.settings, MapStart(known, True, TOLD_OFF))
    poses, covariances = [], []
    for seen in drive.seen:
        rover.step(seen)
        poses.append(rover.pose.as_array())
        covariances.append(rover.covariance.copy())
    errors = np.array([distance_m(pose, true) for pose, true in zip(poses, drive.poses, strict=True)])
    squares = squared_pose_errors(np.array(poses), np.array(covariances), drive.poses)
    return {
        "kind": kind,
        "rms_m": round(float(np.sqrt((errors**2).mean())), 4),
        "largest_m": round(float(errors.max()), 3),
        "nees_median": round(float(np.nanmedian(squares)), 2),
        **compared(known, rover.saved()),
    }


def compared(known: JointMap, after: JointMap) -> Result:
    """moved_m: how far the landmarks of a map have moved; gone: how many of them nobody believes in any more."""
    stand = dict(zip(after.identities.tolist(), after.means_m, strict=True))
    places = zip(known.identities.tolist(), known.means_m, strict=True)
    moved = [float(np.abs(stand[identity] - mean).max()) for identity, mean in places if identity in stand]
    return {"moved_m": max(moved), "gone": len(known) - len(moved)}
