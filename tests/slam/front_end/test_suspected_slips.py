"""Wheels that are sure of themselves, and scans in which people walk together as a place would slide."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from drivers.simulated.world.places.world import World
from runtime.studies.loss_detection.drives import MIDDLE_BEAM, PERIOD_NS, WheelReadings
from runtime.studies.loss_detection.trial import place
from slam.arithmetic.small_matrices import inverse
from slam.front_end.alignment import Alignment
from slam.odometry.odometry import Increment, Odometry
from slam.odometry.slip import SLIDE_MPS, corrected, is_too_far
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from slam.settings.odometry import OdometrySettings

ROLLED = Increment(np.array((0.05, 0.0, 0.01)), np.diag((1e-3, 1e-3, 2e-3)) ** 2, False, True, 0.1, 0.5, 0.0, 0.1, 0.1)
BEFORE_S = 10.0


@pytest.mark.parametrize(
    ("where", "seed", "at_s", "is_taken"),
    [("open", 0, 71.14, False), ("open", 1, 31.94, True), ("open", 4, 76.04, False), ("crowd", 3, 84.24, True)],
)
def test_people_who_walk_together_are_no_slide_that_is_sure(where: str, seed: int, at_s: float, is_taken: bool) -> None:
    """What the rover cannot have done is not taken; what it can have done leaves the wheels' place as likely."""
    taken = 0
    for by_wheels, told in drive(where, seed, at_s):
        slid = told.mean[:2] - by_wheels.mean[:2]
        if told.mean is by_wheels.mean or math.hypot(*slid) < 0.02:
            continue
        taken += 1
        assert not is_too_far(by_wheels, told.mean)
        assert slid @ np.linalg.inv(told.covariance[:2, :2]) @ slid < 1.0
    assert (taken > 0) == is_taken


def drive(where: str, seed: int, until_s: float) -> list[tuple[Increment, Increment]]:
    """The increments by the wheels and after alignment of the last seconds before until_s."""
    settings = place(where, seed)
    laser, world, wheels = settings.laser, World(settings), WheelReadings(settings)
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    odometry, alignment = Odometry(OdometrySettings()), Alignment(FrontEndSettings(), Pose2(*laser.body_from_laser))
    increments = []
    for start_ns in range(round((until_s - BEFORE_S) * 10.0) * PERIOD_NS, round(until_s * 1e9), PERIOD_NS):
        stamp_ns = start_ns + round(MIDDLE_BEAM * laser.beam_period_s * 1e9)
        ranges = world.ranges_at(start_ns)
        seen = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
        odometry.add(wheels.until(stamp_ns))
        by_wheels = odometry.take_until(stamp_ns)
        scan = Scan(stamp_ns, seen, bearings, laser.beam_period_s, MIDDLE_BEAM, laser.range_max_m)
        increments.append((by_wheels, alignment.refine(scan, by_wheels)))
    return increments


def test_a_rover_slides_little_farther_than_its_wheels_roll() -> None:
    farthest_m = 0.05 + SLIDE_MPS * 0.1
    assert not is_too_far(ROLLED, np.array((-farthest_m + 1e-9, 0.0, 2.0)))
    assert is_too_far(ROLLED, np.array((0.0, farthest_m + 1e-9, 0.0)))
    assert not is_too_far(replace(ROLLED, duration_s=1.0), np.array((0.0, farthest_m + 1e-9, 0.0)))


def test_a_slide_that_is_only_suspected_may_not_have_been_but_a_turn_has() -> None:
    information = inverse(np.diag((0.01, 0.01, 0.005)) ** 2)
    motion = np.array((0.05, 0.08, 0.15))
    sure = corrected(ROLLED, motion, information, suspected=False)
    doubted = corrected(ROLLED, motion, information, suspected=True)
    assert np.allclose(sure.mean, motion)
    assert np.allclose(doubted.mean, motion)
    assert np.allclose(sure.covariance, inverse(information))
    wider = np.zeros((3, 3))
    wider[1, 1] = 0.08**2
    assert np.allclose(doubted.covariance - sure.covariance, wider)
