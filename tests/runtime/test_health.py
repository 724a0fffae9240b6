from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import SensorHealth, SensorState
from runtime.health import SETTLED_NS, HealthMonitor, PlaceInMap, RunState
from runtime.tick import SinkHealth
from slam.estimate import Estimate, Quality, Recognition
from slam.pose import Pose2

FRESH = SensorHealth(SensorState.FRESH, "", 10.0)
NOWHERE, ZERO = Pose2(), np.zeros((3, 3))
QUIET = {"record": SinkHealth(0, 0)}


def estimate_of(quality: Quality, doubt: str = "") -> Estimate:
    return Estimate(0, NOWHERE, ZERO, NOWHERE, ZERO, NOWHERE, quality, doubt=doubt)


WELL = estimate_of(Quality.TRACKING)


def test_all_well_is_running_and_said_once() -> None:
    monitor = HealthMonitor()
    health, events = monitor.assess(1, {"laser": FRESH}, QUIET, WELL)
    assert health.state is RunState.RUNNING
    assert [event.kind for event in events] == ["running"]
    assert monitor.assess(2, {"laser": FRESH}, QUIET, WELL)[1] == ()


@pytest.mark.parametrize("state", [SensorState.STALE, SensorState.FAILED, SensorState.STARTING])
def test_a_sensor_in_trouble_degrades_with_its_name_state_and_reason(state: SensorState) -> None:
    health, events = HealthMonitor().assess(1, {"laser": SensorHealth(state, "cable", 0.0)}, QUIET, WELL)
    assert health.state is RunState.DEGRADED
    assert health.reasons == (f"laser {state}: cable",)
    assert "cable" in events[0].reason


def test_a_changed_figure_in_a_reason_is_no_new_event() -> None:
    monitor = HealthMonitor()
    monitor.assess(1, {"laser": SensorHealth(SensorState.STALE, "0.6 s old", 0.0)}, QUIET, WELL)
    later = SensorHealth(SensorState.STALE, "0.7 s old", 0.0)
    assert monitor.assess(2, {"laser": later}, QUIET, WELL)[1] == ()


def test_a_sink_that_drops_degrades_only_while_it_drops() -> None:
    monitor = HealthMonitor()
    states = [
        monitor.assess(k, {"laser": FRESH}, {"record": SinkHealth(0, dropped)}, WELL)[0].state
        for k, dropped in enumerate((0, 3, 3))
    ]
    assert states == [RunState.RUNNING, RunState.DEGRADED, RunState.RUNNING]


def test_a_lost_pose_outranks_a_degraded_sensor() -> None:
    stale = SensorHealth(SensorState.STALE, "silent", 0.0)
    assert HealthMonitor().assess(1, {"laser": stale}, QUIET, estimate_of(Quality.LOST))[0].state is RunState.LOST


def test_a_doubted_pose_is_a_reason_and_each_change_of_it_an_event() -> None:
    monitor = HealthMonitor()
    doubts = [
        (Quality.TRACKING, ""),
        (Quality.UNCERTAIN, "nothing on the map is seen: for 0.9 s"),
        (Quality.UNCERTAIN, "nothing on the map is seen: for 1.0 s"),
        (Quality.LOST, "nothing on the map is seen: for 2.1 s"),
        (Quality.TRACKING, ""),
    ]
    told = [
        monitor.assess(k * SETTLED_NS, {"laser": FRESH}, QUIET, estimate_of(*doubt)) for k, doubt in enumerate(doubts)
    ]
    assert [health.state for health, _ in told] == ["running", "degraded", "degraded", "lost", "running"]
    assert [len(events) for _, events in told] == [1, 1, 0, 1, 1]
    assert told[3][1][0].reason == "lost: pose lost, nothing on the map is seen: for 2.1 s"


LOST = estimate_of(Quality.LOST, "nothing on the map is seen: for 2.0 s")
UNCERTAIN = estimate_of(Quality.UNCERTAIN, "landmarks are not where they should be: found 0, missed 11")
TICK_NS = 100_000_000


@pytest.mark.parametrize("turns", [(WELL, UNCERTAIN), (UNCERTAIN, LOST), (WELL, LOST, UNCERTAIN, LOST)])
@pytest.mark.parametrize("ticks_of_each", [1, 3, 10])
def test_what_flickers_at_its_threshold_is_told_once_and_its_end_when_it_has_settled(
    turns: tuple[Estimate, ...], ticks_of_each: int
) -> None:
    monitor, told = HealthMonitor(), []
    flicker = [turns[k // ticks_of_each % len(turns)] for k in range(600)]
    for k, estimate in enumerate((*flicker, *(WELL,) * 25)):
        health, events = monitor.assess(k * TICK_NS, {"laser": FRESH}, QUIET, estimate)
        assert (
            health.state
            == {Quality.TRACKING: "running", Quality.UNCERTAIN: "degraded", Quality.LOST: "lost"}[estimate.quality]
        )
        told += [(k, event.kind) for event in events]
    assert len(told) <= 3
    assert told[-1][1] == "running"
    assert told[-1][0] >= 600 + SETTLED_NS // TICK_NS - ticks_of_each


def test_a_new_reason_is_told_while_another_flickers() -> None:
    monitor = HealthMonitor()
    for k in range(20):
        monitor.assess(k * TICK_NS, {"laser": FRESH}, QUIET, (WELL, UNCERTAIN)[k % 2])
    stale = SensorHealth(SensorState.STALE, "no scan", 0.0)
    (event,) = monitor.assess(20 * TICK_NS, {"laser": stale}, QUIET, WELL)[1]
    assert event.reason == "degraded: laser stale: no scan"


def test_a_recognised_place_is_an_event_with_its_figures() -> None:
    monitor = HealthMonitor()
    monitor.assess(1, {"laser": FRESH}, QUIET, WELL)
    found = Recognition(
        map_id=1, joined=2, odds=16.4, mirror_odds=3.1, probability_wrong=1e-3, matches=9, moved_m=35.8, turned_rad=-0.5
    )
    (event,) = monitor.assess(2, {"laser": FRESH}, QUIET, replace(WELL, recognition=found))[1]
    for part in ("map 1", "map 2", "9 landmarks", "odds 16 (mirror image 3)", "0.001", "35.8 m", "-29 deg"):
        assert part in event.reason
    (event,) = monitor.assess(3, {"laser": FRESH}, QUIET, replace(WELL, recognition=Recognition(3, is_new=True)))[1]
    assert event.kind == "new map"
    assert "map 3" in event.reason


def test_health_says_which_map_since_when_and_the_last_recognition() -> None:
    monitor = HealthMonitor()

    def assessed(stamp_ns: int, map_id: int, found: Recognition | None = None) -> PlaceInMap | None:
        counts = {"map_id": float(map_id)} if map_id else {}
        estimate = replace(WELL, counts=counts, recognition=found)
        return monitor.assess(stamp_ns, {"laser": FRESH}, QUIET, estimate)[0].place

    assert assessed(1, 0) is None
    assert assessed(2, 1) == PlaceInMap(1, 2)
    assert assessed(3, 0) == PlaceInMap(1, 2)  # a tick without a scan
    assert assessed(4, 2, Recognition(2, is_new=True)) == PlaceInMap(2, 4)
    found = Recognition(1, joined=2, odds=16.4, matches=9)
    assert assessed(5, 1, found) == PlaceInMap(1, 5, 5, found)
    assert assessed(6, 1) == PlaceInMap(1, 5, 5, found)
