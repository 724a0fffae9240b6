"""A number that is none never reaches a viewer, and nothing of it ends the thread that hears the rover."""

import json
import math

import numpy as np
import pytest

from runtime.messages.definitions import deserialize, serialize
from runtime.page.rover_state import RoverState
from runtime.publish.follow import Message
from runtime.ros2.poses import POSE, pose_bytes
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
