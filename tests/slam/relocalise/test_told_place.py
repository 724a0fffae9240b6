"""Somebody says where the rover stands: believed where what is around agrees, else refused with a reason."""

import math

import numpy as np
import pytest

from slam.pose import Pose2
from slam.recognise.prior import PosePrior
from slam.relocalise.search import TOLD_SCANS
from tests.slam.relocalise.test_relocaliser import PARK, RADIUS_M, after_a_lap
from tests.support.slam.tree_drive import TreeDrive


def told(drive: TreeDrive, off: Pose2, sigma_m: float = 0.5) -> list[str]:
    """Say that the rover is `off` its true place; drive on until something has come of it. Returns the refusals."""
    drive.relocaliser.tell(PosePrior(drive.truth @ off, sigma_m, 0.26))
    known = len(drive.recognitions)
    for _ in range(TOLD_SCANS + 4):
        drive.step(0.5 / RADIUS_M)
        refusal = drive.relocaliser.take_refusal()
        if refusal or len(drive.recognitions) > known:
            return [refusal] if refusal else []
    raise AssertionError("nothing has come of it")


@pytest.mark.parametrize("off", [Pose2(), Pose2(0.6, -0.5, 0.3), Pose2(-0.8, 0.2, -0.4)])
def test_a_rover_that_was_carried_and_told_where_is_there_at_once(off: Pose2) -> None:
    drive = after_a_lap()
    drive.step(carried=Pose2(20.0, 15.0, 2.0))
    assert told(drive, off) == []
    (found,) = drive.recognitions
    assert drive.error_m() < 0.5
    assert found.moved_m > 20.0
    drive.circle(40, RADIUS_M)
    assert drive.error_m() < 0.5
    assert len(drive.recognitions) == 1


def test_a_pose_that_nothing_agrees_with_is_refused_and_the_rover_goes_on() -> None:
    drive = after_a_lap()
    (refusal,) = told(drive, Pose2(30.0, -20.0, 1.0))
    assert "nothing agrees with the given pose" in refusal
    assert "landmarks seen" in refusal
    assert not drive.recognitions
    assert drive.error_m() < 0.5
    assert not drive.quality.is_doubted


def test_in_a_saved_map_four_landmarks_are_enough_for_who_is_told() -> None:
    known = after_a_lap().joint
    place = Pose2(10.0, 30.0, 2.0)
    near = np.argsort(np.hypot(*(place.inverse().transform(PARK)).T))[:5]
    drive = TreeDrive(9, PARK[near])
    drive.truth = place
    drive.relocaliser.add_map(known)
    drive.relocaliser.tell(PosePrior(place, 0.5, 0.26))
    steps = 0
    while not drive.recognitions and steps < 20:
        drive.step(ahead_m=0.0 if steps else 0.1)
        steps += 1
    (found,) = drive.recognitions
    assert found.matches <= 5
    assert drive.error_m() < 0.3
    assert not drive.relocaliser.awaits_saved


def test_what_was_said_is_part_of_the_state() -> None:
    drive = after_a_lap()
    before = drive.relocaliser.state_bytes()
    drive.relocaliser.tell(PosePrior(Pose2(1.0, 2.0, 3.0), 0.5, 0.26))
    one = drive.relocaliser.state_bytes()
    drive.relocaliser.tell(PosePrior(Pose2(1.0, 2.0, math.pi), 0.5, 0.26))
    assert len({before, one, drive.relocaliser.state_bytes()}) == 3
