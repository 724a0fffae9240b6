import math

import numpy as np
import pytest

from drivers.measurements import FloatArray
from slam.pose import Pose2
from slam.relocalise import relocaliser
from tests.support.slam.tree_drive import TreeDrive

RADIUS_M = 25.0
LAP = round(2.0 * math.pi * RADIUS_M / 0.5)


def forest(seed: int, middle: tuple[float, float], width_m: float, count: int) -> FloatArray:
    """Trees that do not stand closer together than 2 m."""
    generator = np.random.default_rng(seed)
    trees: list[FloatArray] = []
    while len(trees) < count:
        tree = np.array(middle) + generator.uniform(-0.5 * width_m, 0.5 * width_m, 2)
        if all(math.dist(tree, other) > 2.0 for other in trees):
            trees.append(tree)
    return np.array(trees)


PARK = forest(1, (0.0, RADIUS_M), 110.0, 150)


def after_a_lap() -> TreeDrive:
    drive = TreeDrive(1, PARK)
    drive.circle(LAP + 20, RADIUS_M)
    return drive


def test_without_a_slip_nothing_is_recognised() -> None:
    drive = after_a_lap()
    assert not drive.recognitions
    assert drive.error_m() < 0.3
    assert drive.relocaliser.searching == ""


@pytest.mark.parametrize("carried", [Pose2(20.0, 15.0, 2.0), Pose2(-6.0, 30.0, -0.5), Pose2(0.0, 0.0, math.pi)])
def test_a_carried_rover_finds_back(carried: Pose2) -> None:
    drive = after_a_lap()
    before = drive.joint.landmark_count
    drive.step(carried=carried)
    steps = 0
    while not drive.recognitions and steps < 60:
        drive.step(0.5 / RADIUS_M)
        steps += 1
    (found,) = drive.recognitions
    assert drive.error_m() < 0.5
    assert found.map_id == 1
    assert not found.is_new
    assert found.odds >= 14.0
    assert found.mirror_odds < found.odds - 5.0
    assert found.probability_wrong == 1e-3
    drive.circle(40, RADIUS_M)
    assert drive.error_m() < 0.5
    assert not drive.quality.is_doubted
    assert drive.joint.landmark_count < before + 25
    assert len(drive.recognitions) == 1


def test_what_is_compared_scan_by_scan_never_jumps() -> None:
    drive = after_a_lap()
    drive.step(carried=Pose2(20.0, 15.0, 2.0))
    before = drive.relocaliser.continuous(drive.joint.map_from_body)
    while not drive.recognitions:
        before = drive.relocaliser.continuous(drive.joint.map_from_body)
        drive.step(0.5 / RADIUS_M)
    off = before.inverse() @ drive.relocaliser.continuous(drive.joint.map_from_body)
    assert math.hypot(off.x_m, off.y_m) < 1.5


def test_lost_on_new_ground_a_new_map_begins_and_the_old_one_is_joined_when_it_is_seen_again() -> None:
    elsewhere = forest(2, (400.0, 0.0), 140.0, 200)
    drive = TreeDrive(1, np.vstack((PARK, elsewhere)))
    drive.circle(LAP + 20, RADIUS_M)
    home = drive.truth
    drive.step(carried=drive.truth.inverse() @ Pose2(400.0, 0.0, 1.0))
    drive.circle(80, 20.0)
    assert [found.is_new for found in drive.recognitions] == [True]
    assert drive.recognitions[0].map_id == 2
    assert not drive.quality.is_doubted
    drive.step(carried=drive.truth.inverse() @ home)
    drive.circle(40, RADIUS_M)
    back = drive.recognitions[-1]
    assert not back.is_new
    assert back.map_id == 1
    assert drive.error_m() < 0.5


def test_a_slip_between_two_parts_of_the_map_is_found_without_being_lost() -> None:
    """Where nothing is mapped nothing is missed: only the search for what was left notices it."""
    strip = np.vstack((forest(3, (45.0, 0.0), 90.0, 90), forest(4, (300.0, 0.0), 90.0, 60)))
    drive = TreeDrive(2, strip)
    drive.straight(180)
    drive.step(carried=drive.truth.inverse() @ Pose2(0.0, 0.0, 0.0))
    drive.straight(120)
    assert drive.recognitions
    assert not any(found.is_new for found in drive.recognitions)
    assert drive.error_m() < 0.7


def test_the_same_drive_gives_the_same_bytes_and_the_hash_sees_the_search() -> None:
    def bytes_of(carried: Pose2) -> bytes:
        drive = TreeDrive(1, PARK)
        drive.circle(60, RADIUS_M)
        drive.step(carried=carried)
        drive.circle(30, RADIUS_M)
        return drive.joint.state_bytes() + drive.relocaliser.state_bytes()

    assert bytes_of(Pose2(20.0, 15.0, 2.0)) == bytes_of(Pose2(20.0, 15.0, 2.0))
    drive = TreeDrive(1, PARK)
    drive.circle(60, RADIUS_M)
    before = drive.relocaliser.state_bytes()
    drive.step(carried=Pose2(20.0, 15.0, 2.0))
    while not drive.quality.is_doubted:
        drive.step()
    assert drive.relocaliser.state_bytes() != before


def test_the_smallest_of_too_many_maps_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relocaliser, "MOST_ISLANDS", 1)
    drive = after_a_lap()
    drive.relocaliser.add_map(TreeDrive(5, PARK[:0]).joint)
    drive.relocaliser.add_map(after_a_lap().joint)
    assert drive.relocaliser.figures["maps_known"] == 2.0


def test_a_map_of_before_is_recognised_from_anywhere_in_it() -> None:
    known = after_a_lap().joint
    drive = TreeDrive(9, PARK)
    drive.truth = Pose2(10.0, 30.0, 2.0)
    drive.relocaliser.add_map(known)
    steps = 0
    while not drive.recognitions and steps < 60:
        drive.step()
        steps += 1
    (found,) = drive.recognitions
    assert found.joined == 1
    assert drive.error_m() < 0.5
