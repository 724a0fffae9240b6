"""A number that is none never reaches a viewer, and nothing of it ends the thread that hears the rover."""

import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from runtime.messages.definitions import deserialize, serialize
from runtime.page.rover_state import CELL_M, RoverState
from runtime.publish.follow import Message
from runtime.ros2.laser_scan import scan_bytes
from runtime.ros2.poses import POSE, pose_bytes
from runtime.ros2.vehicle import Vehicle
from slam.pose import Pose2
from tests.support.runtime.drawn_drive import MOUNT, PERIOD_NS
from tests.support.runtime.recorded_values import make_estimate


def pose_with(value: float) -> bytes:
    """A pose whose heading is what a stranger says."""
    message = deserialize(POSE, pose_bytes(1, make_estimate(1, np.random.default_rng(0))))
    message.pose.pose.orientation.z = message.pose.pose.orientation.w = value
    return serialize(POSE, message)


def test_a_heading_that_is_no_number_changes_nothing() -> None:
    """Ten a second kept the page dead: what it says as JSON raised in the thread that hears the rover."""
    state = RoverState("r1")
    state.take(Message("pose", pose_bytes(1, make_estimate(1, np.random.default_rng(0)))))
    before = state.beat(True)
    state.take(Message("pose", pose_with(math.nan)))
    assert state.beat(True) == before
    assert json.dumps(state.beat(True), allow_nan=False)


@pytest.mark.parametrize("value", [math.inf, -math.inf, 1e308, -1e308, 0.0, 5e-324])
def test_any_quaternion_is_drawn_or_passed_over(value: float) -> None:
    state = RoverState("r1")
    state.take(Message("pose", pose_with(value)))
    assert json.dumps(state.beat(True), allow_nan=False)


@pytest.mark.parametrize("bits", [0x7F800001, 0xFF800001, 0x7F800000])
def test_ranges_that_are_no_numbers_are_passed_over_without_a_warning(bits: int) -> None:
    """A signalling NaN, which no laser has, warned in the journal of the page when it was made wider."""
    state = RoverState("r1")
    state.take(Message("pose", pose_bytes(1, make_estimate(1, np.random.default_rng(0)))))
    ranges_m = np.array((bits, bits), np.uint32).view(np.float32)
    scan = Scan(1, ranges_m, uniform_bearings(0.0, 0.1, 2), 0.0, range_max_m=30.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state.take(Message("scan_full", scan_bytes(scan, 0, Vehicle())))
    assert json.dumps(state.beat(True), allow_nan=False)
    assert state.beat(True)["scan"] == []


def test_who_walks_by_leaves_no_cells_and_what_stands_still_does() -> None:
    state = RoverState("r1")
    state.begin(MOUNT)
    still = replace(make_estimate(1, np.random.default_rng(0)), map_from_body=Pose2(0.0, 0.0, 0.0))
    bearings_rad = uniform_bearings(-np.pi, np.pi / 180.0, 360)
    for beat in range(60):
        stamp_ns = beat * PERIOD_NS
        ranges_m = np.full(360, np.nan, np.float32)
        ranges_m[50:60] = 3.0  # a post
        ranges_m[150 + 2 * beat : 160 + 2 * beat] = 2.0  # who walks around the rover with 0.7 m/s
        scan = Scan(stamp_ns, ranges_m, bearings_rad, 0.0, range_max_m=30.0)
        state.take(Message("pose", pose_bytes(stamp_ns, still)))
        state.take(Message("scan_full", scan_bytes(scan, 0, Vehicle())))
    ranges_m = np.hypot(*(np.array(state.cells) * CELL_M + CELL_M / 2 - np.array((MOUNT.x_m, 0.0))).T)
    assert len(state.cells) > 0
    assert ranges_m == pytest.approx(3.0, abs=CELL_M)
