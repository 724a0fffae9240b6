import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import FloatArray, Scan
from slam.front_end.alignment import Alignment
from slam.front_end.alignment_kernels import EarlierScans, surface_normals
from slam.front_end.alignment_search import Search
from slam.front_end.deskew import Beams, Twist, deskew
from slam.front_end.wide_search import View, WideSearch
from slam.odometry.odometry import Increment
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from tests.support.slam.corridor import BEARINGS_RAD, RANGE_MAX_M, RANGE_SIGMA_M, ranges_of, ring_of_corridors

MOUNT = Pose2(0.1, 0.0, 0.0)
LINES = ring_of_corridors(2)
AT_A_CORNER = Pose2(20.0, 0.0, 0.3)
IN_A_CORRIDOR = Pose2(10.0, 0.0, 0.0)
AT_REST = Increment(np.zeros(3), np.zeros((3, 3)), True, True, 0.1, 0.0, 0.0, 0.0)
NARROW = np.diag((0.05**2, 0.02**2, 0.06**2))
SETTINGS = FrontEndSettings.model_validate({"range_max_m": 20.0, "width_max_m": 0.4})


def scan_at(pose: Pose2, number: int, lines: FloatArray = LINES) -> Scan:
    noise = np.random.default_rng(number).normal(0.0, RANGE_SIGMA_M, BEARINGS_RAD.size)
    ranges = (ranges_of(pose @ MOUNT, lines) + noise).astype(np.float32)
    return Scan(number * 3_000_000_000, ranges, BEARINGS_RAD, range_max_m=RANGE_MAX_M)


def search_of(before: Pose2, after: Pose2, lines: FloatArray = LINES) -> WideSearch:
    last, new = beams_of(scan_at(before, 1)), beams_of(scan_at(after, 2, lines))
    normals = np.empty_like(last.points_m)
    surface_normals(last.points_m, last.spacing_rad, normals)
    start = np.array(((-MOUNT.x_m, 0.0, 1.0, 0.0),))
    past = EarlierScans(last.points_m[None], normals[None], start, float(BEARINGS_RAD[0]), last.spacing_rad)
    points = new.points_m[~np.isnan(new.points_m[:, 0])]
    return WideSearch(Search(MOUNT.transform(points), past), View.of(new), View.of(last), MOUNT)


def beams_of(scan: Scan) -> Beams:
    return deskew(scan, Twist(), MOUNT, 0.1, 20.0)


@pytest.mark.parametrize("turned_deg", [-80, -60, -40, 40, 80])
def test_a_turn_that_the_wheels_said_nothing_of_is_found(turned_deg: float) -> None:
    turn = Pose2(0.0, 0.0, math.radians(turned_deg))
    found = search_of(AT_A_CORNER, AT_A_CORNER @ turn).best(np.zeros(3))
    assert found is not None
    off = turn.inverse() @ Pose2(*found[0].tolist())
    assert math.hypot(off.x_m, off.y_m) < 0.1
    assert abs(off.heading_rad) < 0.03


def test_a_turn_that_leaves_little_in_common_is_found_rightly_or_not_at_all() -> None:
    for turned_deg in (-170, -140, -110, 110, 140, 170):
        turn = Pose2(0.0, 0.0, math.radians(turned_deg))
        found = search_of(AT_A_CORNER, AT_A_CORNER @ turn).best(np.zeros(3))
        assert found is None or abs(math.remainder(found[0][2] - turn.heading_rad, 2.0 * math.pi)) < 0.05


def test_a_rover_that_has_slid_metres_is_found() -> None:
    slid = Pose2(0.6, 0.0, 0.0)
    found = search_of(AT_A_CORNER, AT_A_CORNER @ slid).best(np.array((2.6, 0.1, 0.05)))
    assert found is not None
    off = slid.inverse() @ Pose2(*found[0].tolist())
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


def test_an_aligned_rover_that_was_turned_at_rest_knows_its_heading() -> None:
    alignment, turn = Alignment(SETTINGS, MOUNT), Pose2(0.0, 0.0, -1.4)
    for number in range(1, 5):
        alignment.refine(scan_at(AT_A_CORNER, number), AT_REST)
    told = alignment.refine(scan_at(AT_A_CORNER @ turn, 5), AT_REST)
    assert alignment.found_widely == 1
    assert not told.at_rest
    assert told.mean == pytest.approx(turn.as_array(), abs=0.05)
    assert math.sqrt(told.covariance[2, 2]) < 0.05


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
