"""A rover that is put down elsewhere among walls: few corners have been seen often enough to be missed there."""

import math

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.building import Building
from drivers.simulated.world.places.choose import world_of
from runtime.studies.loss_detection.drives import MIDDLE_BEAM, PERIOD_NS, WheelReadings, simulated_ticks
from runtime.studies.loss_detection.trial import place
from slam.estimate import Estimate, Quality
from slam.estimator import Estimator
from slam.quality import QualityMonitor
from slam.settings.slam import SlamSettings
from tests.slam.test_quality import GONE, GOOD, NARROW, SETTINGS, TICK_NS, after, quality

WATCHED_S = 3.0


@pytest.mark.parametrize(
    ("seed", "at_s", "moved_m", "turn_deg"),
    [(7, 12.0, (2.0, 1.0), 60.0), (0, 20.0, (3.0, 0.0), 0.0), (1, 25.0, (0.0, 0.0), 120.0)],
)
def test_a_rover_carried_off_in_a_building_says_so_at_once_and_did_not_before(
    seed: int, at_s: float, moved_m: tuple[float, float], turn_deg: float
) -> None:
    kidnap = {"start_s": at_s, "x_m": moved_m[0], "y_m": moved_m[1], "turn_deg": turn_deg}
    said = drive(WorldSettings.model_validate({"seed": seed, "place": "building", "kidnaps": [kidnap]}), at_s)
    carried = round(at_s * 10.0)
    assert all(estimate.quality is Quality.TRACKING for estimate in said[:carried])
    assert said[carried + 1].quality is Quality.LOST
    assert said[carried + 1].doubt.startswith("the rover is not where it was: a scan fits nowhere near the one before")
    assert all(estimate.quality is not Quality.TRACKING for estimate in said[carried + 1 :])


def test_people_between_whom_landmarks_are_found_carry_no_rover_off() -> None:
    """An open field: at 30.0 s a scan fits nowhere near the one before, and its landmarks are where they should be."""
    world = place("open", 4)
    mount = {"x_m": world.laser.body_from_laser[0]}
    estimator = Estimator(SlamSettings.model_validate({"mount": mount}), 4)
    torn = 0
    for tick in simulated_ticks(world, 31.0):
        assert estimator.step(tick.stamp_ns, tick.scan, tick.wheels).quality is Quality.TRACKING
        torn += estimator._alignment.is_torn
    assert torn > 0


def drive(settings: WorldSettings, at_s: float) -> list[Estimate]:
    """The estimates of a drive that ends a while after at_s."""
    world = world_of(settings)
    assert isinstance(world, Building)
    laser, wheels = world.settings.laser, WheelReadings(world.settings, world.path)
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    mount = {"x_m": laser.body_from_laser[0]}
    estimator, said = Estimator(SlamSettings.model_validate({"mount": mount}), settings.seed), []
    for start_ns in range(0, round((at_s + WATCHED_S) * 1e9), PERIOD_NS):
        stamp_ns = start_ns + round(MIDDLE_BEAM * laser.beam_period_s * 1e9)
        ranges = world.sweep_at(start_ns).ranges_m
        seen = np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32)
        scan = Scan(stamp_ns, seen, bearings, laser.beam_period_s, MIDDLE_BEAM, laser.range_max_m)
        said.append(estimator.step(stamp_ns, scan, wheels.until(stamp_ns)))
    return said


def test_a_rover_that_is_not_where_it_was_is_lost_until_its_scans_lie_on_the_map() -> None:
    monitor, now_ns = after(*[GOOD] * 20)
    torn_from = monitor.state_bytes()
    monitor.tear()
    assert monitor.state_bytes() != torn_from
    assert monitor.judge(now_ns, NARROW, 0.0).doubt.startswith("the rover is not where it was")
    for lies_on_map, said in ((False, Quality.LOST), (True, Quality.TRACKING)):
        for _ in range(10):
            now_ns += TICK_NS
            monitor.add(now_ns, GONE if not lies_on_map else GOOD, 1.0, lies_on_map=lies_on_map)
        assert quality(monitor, now_ns) is said
    for _ in range(2 * math.ceil(SETTINGS.lost_score / GONE.against)):
        now_ns += TICK_NS
        monitor.add(now_ns, GONE)
    assert monitor.judge(now_ns, NARROW, 0.0).doubt.startswith("landmarks are not where they should be")


def test_a_place_that_is_recognised_mends_it() -> None:
    monitor = QualityMonitor(SETTINGS)
    monitor.tear()
    monitor.restart(TICK_NS)
    assert monitor.judge(TICK_NS, NARROW, 0.0).quality is not Quality.LOST
