"""A drive that begins anywhere in a saved map searches, says so, and goes on in the map when it knows its place."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers.settings.simulated_world import WorldSettings
from runtime.studies.loss_detection.drives import simulated_ticks
from slam.estimate import Quality
from slam.estimator import Estimator
from slam.joint.gaussian import JointGaussian
from slam.maps.joint_map import JointMap, take_map
from slam.maps.start import MapStart, first_maps
from slam.maps.views import NO_VIEWS
from slam.pose import Pose2
from slam.quality import Judgement, QualityMonitor
from slam.relocalise.relocaliser import Relocaliser
from slam.settings.slam import SlamSettings
from tests.slam.relocalise.test_relocaliser import PARK, after_a_lap, forest
from tests.support.slam.tree_drive import SETTINGS, TreeDrive

TRACKING = Judgement(Quality.TRACKING)
SETTINGS_OF_PARK = SlamSettings.model_validate(
    {"mount": {"x_m": WorldSettings().laser.body_from_laser[0]}, "particles": 2}
)


@cache
def known() -> JointMap:
    return take_map(after_a_lap().joint)


def beginning(start: MapStart, truth: Pose2, seed: int = 9) -> tuple[TreeDrive, JointGaussian]:
    drive = TreeDrive(seed, PARK)
    drive.truth = truth
    drive.joint, saved = first_maps(SETTINGS, start)
    assert saved is not None
    drive.quality = QualityMonitor(SETTINGS.quality, drive.joint.scans, is_told=saved is drive.joint)
    drive.relocaliser = Relocaliser(SETTINGS, drive.joint, saved)
    return drive, saved


@pytest.mark.parametrize("localise_only", [True, False])
def test_a_start_anywhere_is_recognised_and_until_then_searches(localise_only: bool) -> None:
    drive, saved = beginning(MapStart(known(), localise_only, None), Pose2(10.0, 30.0, 2.0))
    before = known().digest()
    steps = 0
    while not drive.recognitions and steps < 60:
        judged = drive.relocaliser.judged(TRACKING)
        assert judged.quality is Quality.LOST
        assert judged.doubt.startswith("searching the map: ")
        drive.step()
        steps += 1
    assert drive.recognitions
    assert drive.joint is saved is drive.relocaliser.lasting.joint
    assert drive.error_m() < 0.5
    assert drive.relocaliser.judged(TRACKING) == TRACKING
    drive.circle(60, 25.0)
    assert drive.error_m() < 0.5
    assert known().digest() == before
    if localise_only:
        atlas = drive.joint.state.atlas
        saved_rows = np.flatnonzero(atlas.frozen & (atlas.place >= -1))
        order = np.argsort(atlas.identities[saved_rows])
        means = drive.joint.state.settled_means()[saved_rows[order]]
        assert np.array_equal(means, known().means_m[np.argsort(known().identities)]), "joined, and not moved"


def test_a_rover_that_is_carried_while_it_localises_finds_back_and_the_map_stays() -> None:
    drive, _ = beginning(MapStart(known(), True, Pose2(0.3, -0.2, 0.03)), Pose2())
    assert drive.relocaliser.judged(TRACKING) == TRACKING
    drive.circle(30, 25.0)
    drive.step(carried=Pose2(20.0, 15.0, 2.0))
    steps = 0
    while not drive.recognitions and steps < 60:
        drive.step(0.5 / 25.0)
        steps += 1
    assert drive.recognitions
    assert drive.error_m() < 0.5
    joint, atlas = drive.joint, drive.joint.state.atlas
    rows = [int(np.flatnonzero((atlas.identities == name) & (atlas.place >= -1))[0]) for name in known().identities]
    assert np.array_equal(joint.state.settled_means()[rows], known().means_m)


def test_a_start_outside_the_map_keeps_searching() -> None:
    drive, saved = beginning(MapStart(known(), True, None), Pose2())
    drive._trees_m = forest(77, (0.0, 25.0), 110.0, 150)
    drive.circle(60, 25.0)
    assert not drive.recognitions
    assert drive.relocaliser.awaits_saved
    assert drive.relocaliser.judged(TRACKING).quality is Quality.LOST
    assert drive.relocaliser.lasting.joint is saved, "what is kept at the end is the map, and not this drive"


def test_a_start_pose_that_the_map_refutes_is_as_good_as_none() -> None:
    drive, saved = beginning(MapStart(known(), True, Pose2()), Pose2())
    drive._trees_m = forest(77, (0.0, 25.0), 110.0, 150)
    drive.circle(80, 25.0)
    assert [recognition.is_new for recognition in drive.recognitions] == [True]
    assert drive.relocaliser.judged(TRACKING).quality is Quality.LOST
    assert drive.relocaliser.lasting.joint is saved


def test_in_the_mirror_image_of_a_map_a_start_pose_is_never_believed() -> None:
    """From the second scan on the walls hold the pose, and what may stand anywhere within half a metre is neither found
    nor missed: after 23 s in which nothing more was held against it the pose was called tracking.
    """
    ticks = list(simulated_ticks(WorldSettings(seed=1), 25.0))
    mapped = Estimator(SETTINGS_OF_PARK, 1)
    for tick in ticks[:150]:
        mapped.step(tick.stamp_ns, tick.scan, tick.wheels)
    flip = np.diag((1.0, -1.0))
    own = mapped.joint_map()
    in_mirror = replace(
        own,
        means_m=own.means_m @ flip,
        covariances_m2=flip @ own.covariances_m2 @ flip,
        block_m2=np.kron(np.eye(own.in_state), flip) @ own.block_m2 @ np.kron(np.eye(own.in_state), flip),
        weights=flip @ own.weights @ np.kron(np.eye(4), flip),
        residuals=flip @ own.residuals @ flip,
        view_poses=NO_VIEWS.poses,
        view_points_cm=NO_VIEWS.points_cm,
    )
    rover = Estimator(SETTINGS_OF_PARK, 1, start=MapStart(in_mirror, True, Pose2()))
    said = {rover.step(tick.stamp_ns, tick.scan, tick.wheels).quality for tick in ticks}
    assert said == {Quality.LOST}


def test_the_digest_of_a_start_tells_maps_places_and_modes_apart() -> None:
    starts = [
        MapStart(known(), localise_only, pose)
        for localise_only in (True, False)
        for pose in (None, Pose2(), Pose2(0.1, 0.0, 0.0))
    ]
    assert len({start.digest() for start in starts}) == len(starts)
