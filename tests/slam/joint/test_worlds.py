"""The joint Gaussian alone, with its own association, on the worlds of the paper: figures, a few seeds each."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from drivers.measurements import FloatArray
from runtime.evaluate.errors import TrajectoryError, in_start_frame, squared_pose_errors, trajectory_error
from runtime.studies.paper.drives.worlds import (
    BEARING_NOISE_RAD,
    RANGE_NOISE_M,
    VIEW_M,
    FeatureDrive,
    WorldKind,
    feature_world,
)
from slam.joint.gaussian import JointGaussian
from slam.observations import Features, usable_rows
from slam.odometry.odometry import Odometry
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import SlamSettings, ViewSettings
from slam.visibility import field_of_view

NOISE = np.diag((RANGE_NOISE_M**2, BEARING_NOISE_RAD**2))
TUNING = SlamSettings(view=ViewSettings(range_max_m=VIEW_M + 2.0)).tuning()
SIGHT = field_of_view(VIEW_M - 2.0, math.radians(130.0))
SEEDS = range(4)


@dataclass(frozen=True)
class Run:
    poses: FloatArray
    error: TrajectoryError
    squared_errors: FloatArray
    landmarks: int
    most_in_state: int


@cache
def drive_of(kind: WorldKind, seed: int) -> FeatureDrive:
    return feature_world(kind, seed)


@cache
def run(kind: WorldKind, seed: int, landmarks_in_state: int = JointSettings().landmarks_in_state) -> Run:
    drive = drive_of(kind, seed)
    odometry = Odometry(OdometrySettings(model="speed_yaw_rate"))
    joint = JointGaussian(JointSettings(landmarks_in_state=landmarks_in_state), Pose2(), TUNING)
    poses, covariances, most = [], [], 0
    for step in drive.steps:
        odometry.add(step.wheels)
        increment = odometry.take_until(step.stamp_ns)
        seen = step.sightings
        count = len(seen.ranges_m)
        features = Features(
            step.stamp_ns,
            seen.ranges_m,
            seen.bearings_rad,
            np.tile(NOISE, (count, 1, 1)),
            np.ones(count, dtype=np.bool_),
            seen.identities,
            seen.identities,
        )
        rows = usable_rows(features, TUNING.range_max_m, 0.0)
        joint.step(increment.mean, increment.covariance, rows, rows.identities, SIGHT)
        poses.append(joint.map_from_body.as_array())
        covariances.append(joint.covariance)
        most = max(most, joint.landmarks_in_state)
    true = in_start_frame(drive.truth)
    squared = squared_pose_errors(np.array(poses), np.array(covariances), true)[20:]
    error = trajectory_error(np.array(poses), drive.truth)
    return Run(np.array(poses), error, squared, joint.landmark_count, most)


@pytest.mark.parametrize(("kind", "largest_m", "aligned_m"), [("P", 1.0, 0.20), ("V2", 1.1, 0.25)])
def test_errors_and_their_covariance_are_what_the_method_promises(
    kind: WorldKind, largest_m: float, aligned_m: float
) -> None:
    runs = [run(kind, seed) for seed in SEEDS]
    assert np.mean([one.error.from_start.largest_m for one in runs]) < largest_m
    assert np.mean([one.error.aligned.rms_m for one in runs]) < aligned_m
    assert 1.0 < np.mean([np.nanmedian(one.squared_errors) for one in runs]) < 6.0


@pytest.mark.parametrize("kind", ["P", "V2"])
def test_the_map_has_hardly_more_landmarks_than_were_in_view(kind: WorldKind) -> None:
    for seed in SEEDS:
        ever = int(drive_of(kind, seed).ever_in_view.sum())
        assert 0.97 * ever <= run(kind, seed).landmarks <= 1.2 * ever


def test_a_small_window_is_as_good_as_the_whole_state() -> None:
    whole, window = run("P", 0, 768), run("P", 0, 40)
    assert whole.most_in_state > 1.5 * window.most_in_state
    assert np.abs(whole.poses - window.poses).max() < 0.05
    assert np.nanmedian(window.squared_errors) < 1.3 * np.nanmedian(whole.squared_errors)


def test_one_landmark_at_a_time_gives_an_honest_pose() -> None:
    lonely = run("LONELY", 0)
    assert np.isfinite(lonely.poses).all()
    assert np.isfinite(lonely.squared_errors).all()
    assert np.nanmedian(lonely.squared_errors) < 12.0
    assert lonely.error.from_start.largest_m < 0.1 * math.hypot(100.0, 100.0)
