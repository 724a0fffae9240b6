import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from slam.front_end.alignment import Alignment
from slam.odometry.odometry import Increment
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from tests.support.slam.corridor import ring_of_corridors
from tests.support.slam.wide import AT_A_CORNER, IN_A_CORRIDOR, MOUNT, scan_at, search_between, search_of

AT_REST = Increment(np.zeros(3), np.zeros((3, 3)), True, True, 0.1, 0.0, 0.0, 0.0, 0.0)
SETTINGS = FrontEndSettings.model_validate({"range_max_m": 20.0, "width_max_m": 0.4})


@pytest.mark.parametrize("turned_deg", [-80, -60, -40, 40, 80])
def test_a_turn_that_the_wheels_said_nothing_of_is_found(turned_deg: float) -> None:
    turn = Pose2(0.0, 0.0, math.radians(turned_deg))
    found = search_of(AT_A_CORNER, AT_A_CORNER @ turn).best(np.zeros(3))
    assert found is not None
    off = turn.inverse() @ Pose2(*found.motion.tolist())
    assert math.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.heading_rad) < 0.03


def test_a_turn_that_leaves_little_in_common_is_found_rightly_or_not_at_all() -> None:
    for turned_deg in (-170, -140, -110, 110, 140, 170):
        turn = Pose2(0.0, 0.0, math.radians(turned_deg))
        found = search_of(AT_A_CORNER, AT_A_CORNER @ turn).best(np.zeros(3))
        assert found is None or abs(math.remainder(found.motion[2] - turn.heading_rad, 2.0 * math.pi)) < 0.05


def test_a_rover_that_has_slid_metres_is_found() -> None:
    slid = Pose2(0.6, 0.0, 0.0)
    found = search_of(AT_A_CORNER, AT_A_CORNER @ slid).best(np.array((2.6, 0.1, 0.05)))
    assert found is not None
    off = slid.inverse() @ Pose2(*found.motion.tolist())
    assert math.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.heading_rad) < 0.03


def test_where_the_wheels_are_right_no_other_place_is_found() -> None:
    for number in range(8):
        motion = Pose2(0.1 * number, 0.02 * number, 0.03 * number)
        assert search_of(AT_A_CORNER, AT_A_CORNER @ motion).best(motion.as_array()) is None
        assert search_of(IN_A_CORRIDOR, IN_A_CORRIDOR @ motion).best(motion.as_array()) is None


def test_a_scan_of_another_building_is_found_nowhere() -> None:
    for seed in range(3, 9):
        for x_m in (1.0, 10.0, 20.0):
            pose = Pose2(x_m, 0.0, 0.0)
            assert search_of(AT_A_CORNER, pose, 1.4 * ring_of_corridors(seed)).best(np.zeros(3)) is None


def test_where_pillars_stand_at_equal_distances_none_is_taken_for_another() -> None:
    """Two walls whose pillars stand 1.5 m apart, their ends out of sight: the scan fits at every third half metre."""
    lines = []
    for y_m, side in ((1.2, -1.0), (-1.2, 1.0)):
        lines.append((-90.0, y_m, 90.0, y_m))
        for x_m in np.arange(-60.0, 60.0, 1.5).tolist():
            inner = y_m + 0.3 * side
            corners = ((x_m, y_m), (x_m, inner), (x_m + 0.3, inner), (x_m + 0.3, y_m))
            lines += [(*one, *other) for one, other in itertools.pairwise(corners)]
    hall = np.array(lines)
    for slid_m in (1.5, 3.0):
        search = search_between(scan_at(Pose2(), 1, hall), scan_at(Pose2(slid_m, 0.0, 0.2), 2, hall))
        assert search.best(np.array((0.75, 0.0, 0.0))) is None


def test_a_scan_that_shows_next_to_nothing_is_not_looked_for() -> None:
    turned = scan_at(AT_A_CORNER @ Pose2(0.0, 0.0, 0.7), 2)
    few = turned.ranges_m.copy()
    few[30:] = np.nan
    last = scan_at(AT_A_CORNER, 1)
    assert search_between(last, turned).best(np.zeros(3)) is not None
    assert search_between(last, replace(turned, ranges_m=few)).best(np.zeros(3)) is None


def test_an_aligned_rover_that_was_turned_at_rest_knows_its_heading() -> None:
    alignment, turn = Alignment(SETTINGS, MOUNT), Pose2(0.0, 0.0, -1.4)
    for number in range(1, 5):
        alignment.refine(scan_at(AT_A_CORNER, number), AT_REST)
    told = alignment.refine(scan_at(AT_A_CORNER @ turn, 5), AT_REST)
    assert alignment.found_widely == 1
    assert not told.at_rest
    assert told.mean == pytest.approx(turn.as_array(), abs=0.05)
    assert math.sqrt(told.covariance[2, 2]) < 0.05


def test_a_wall_that_moves_before_a_rover_at_rest_does_not_move_the_rover() -> None:
    """The door of a lift: three quarters of the view come nearer, the rest stays."""
    alignment, still = Alignment(SETTINGS, MOUNT), scan_at(AT_A_CORNER, 1).ranges_m
    for number in range(1, 5):
        alignment.refine(replace(scan_at(AT_A_CORNER, 1), stamp_ns=number * 100_000_000), AT_REST)
    moved = scan_at(AT_A_CORNER @ Pose2(0.25, 0.1, 0.05), 1).ranges_m.copy()
    moved[:45] = still[:45]
    told = alignment.refine(replace(scan_at(AT_A_CORNER, 1), stamp_ns=500_000_000, ranges_m=moved), AT_REST)
    assert told is AT_REST


def test_it_is_looked_for_once_a_second_at_most() -> None:
    alignment = Alignment(SETTINGS, MOUNT)
    for number in range(1, 5):
        alignment.refine(scan_at(AT_A_CORNER, number), AT_REST)
    strange = 1.4 * ring_of_corridors(5)
    stamps = []
    for number in range(5, 45):
        stamp_ns = 12_000_000_000 + (number - 4) * 100_000_000
        before = alignment.searched_ns
        alignment.refine(replace(scan_at(Pose2(1.0 * (number % 9), 0, 0), number, strange), stamp_ns=stamp_ns), AT_REST)
        if alignment.searched_ns != before:
            stamps.append(stamp_ns)
    assert len(stamps) >= 2
    assert min(np.diff(stamps)) >= 1_000_000_000
