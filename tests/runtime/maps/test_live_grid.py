"""The live grid shows what a rover says it sees, and knows when to leave a scan out."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Scan
from runtime.maps.grid_message import GRID, grid_bytes
from runtime.maps.live_grid import LiveGrid
from runtime.messages.definitions import deserialize
from runtime.messages.tick import decode
from runtime.ros2.laser_scan import scan_bytes
from runtime.ros2.poses import pose_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.tick import CompletedTick
from slam.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, GridMap
from slam.pose import Pose2
from slam.settings.slam import SlamSettings
from tests.support.runtime.drawn_drive import MOUNT, YARD_M, completed_ticks

WALL_NS = 1_700_000_000_000_000_000


def heard(completed: CompletedTick, live: LiveGrid, covariance_m2: float = 0.01) -> bool | None:
    """The messages of a tick as the rover sends them; whether its scan was placed."""
    estimate, scan = completed.estimate, completed.tick.scan
    told = replace(estimate, covariance=covariance_m2 * np.eye(3))
    live.add_pose(decode("/pose", pose_bytes(estimate.stamp_ns + WALL_NS, told)))
    if not isinstance(scan, Scan):
        return None
    return live.add_scan(decode("/scan", scan_bytes(scan, WALL_NS, Vehicle(), 3)))


def test_the_walls_of_the_yard_are_in_the_grid() -> None:
    live = LiveGrid(SlamSettings(mount=MOUNT), 0.1)
    placed = [heard(completed, live) for completed in completed_ticks(30)]
    assert placed[0] is False, "no pose before the first scan says where it was"
    assert all(placed[1:])
    message = deserialize(GRID, grid_bytes(live.grid.grid_map(), WALL_NS))
    cells = message.data.reshape(message.info.height, message.info.width)
    rows, columns = np.nonzero(cells == OCCUPIED)
    origin = message.info.origin.position
    points = np.column_stack((columns, rows)) * message.info.resolution + (origin.x, origin.y)
    assert np.mean(np.abs(np.abs(points).max(axis=1) - YARD_M) < 0.3) > 0.7
    assert (cells == FREE).sum() > 50_000


def test_scans_of_a_lost_rover_are_left_out() -> None:
    live = LiveGrid(SlamSettings(mount=MOUNT), 0.1)
    assert not any(heard(completed, live, covariance_m2=100.0) for completed in completed_ticks(5))
    assert live.grid.scans == 0


def test_messages_that_no_rover_sends_are_passed_over_and_named_once() -> None:
    live = LiveGrid(SlamSettings(mount=MOUNT), 0.1)
    for _ in range(3):
        live.take("pose", b"junk")
        live.take("scan", b"")
    assert live.troubles.keys() == {"pose", "scan"}
    assert all("that no rover sends is ignored" in text for text in live.troubles.values())


@pytest.mark.parametrize("x_m", [np.nan, np.inf, 1e300])
def test_a_pose_that_is_nowhere_places_no_scan(x_m: float) -> None:
    live = LiveGrid(SlamSettings(mount=MOUNT), 0.1)
    away = [
        replace(each, estimate=replace(each.estimate, map_from_body=Pose2(x_m, 0.0, 0.0)))
        for each in completed_ticks(5)
    ]
    assert not any(heard(completed, live) for completed in away)
    assert live.grid.scans == 0


def test_a_grid_is_said_as_nav_msgs_has_it() -> None:
    grid = GridMap(np.array([[UNKNOWN, FREE, OCCUPIED], [FREE, FREE, FREE]], np.int8), (-1.5, 2.0), 0.25)
    message = deserialize(GRID, grid_bytes(grid, WALL_NS + 5))
    assert (message.info.width, message.info.height) == (3, 2)
    assert message.data.tolist() == [-1, 0, 100, 0, 0, 0]
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-1.5, 2.0)
    assert message.info.resolution == pytest.approx(0.25)
    assert message.header.frame_id == "map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 5)
