"""A drive that begins anywhere in a saved map searches, says so, and goes on in the map when it knows its place."""

from functools import cache

import numpy as np
import pytest

from slam.estimate import Quality
from slam.joint.gaussian import JointGaussian
from slam.maps.joint_map import JointMap, take_map
from slam.maps.start import MapStart, first_maps
from slam.pose import Pose2
from slam.quality import Judgement, QualityMonitor
from slam.relocalise.relocaliser import Relocaliser
from tests.slam.relocalise.test_relocaliser import PARK, after_a_lap, forest
from tests.support.slam.tree_drive import SETTINGS, TreeDrive

TRACKING = Judgement(Quality.TRACKING)


@cache
def known() -> JointMap:
    return take_map(after_a_lap().joint)


def beginning(start: MapStart, truth: Pose2, seed: int = 9) -> tuple[TreeDrive, JointGaussian]:
    drive = TreeDrive(seed, PARK)
    drive.truth = truth
    drive.joint, saved = first_maps(SETTINGS, start)
    assert saved is not None
    drive.quality = QualityMonitor(SETTINGS.quality, drive.joint.scans)
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


def test_the_digest_of_a_start_tells_maps_places_and_modes_apart() -> None:
    starts = [
        MapStart(known(), localise_only, pose)
        for localise_only in (True, False)
        for pose in (None, Pose2(), Pose2(0.1, 0.0, 0.0))
    ]
    assert len({start.digest() for start in starts}) == len(starts)
