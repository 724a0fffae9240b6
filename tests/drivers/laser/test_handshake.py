"""Whatever state a laser was left in, and whatever it says of itself, over the real wire."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from drivers.laser import hokuyo
from drivers.laser.link import SerialLink
from drivers.laser.request import scan_request
from drivers.measurements import SensorState
from drivers.settings.laser import LaserSettings, SerialEndpoint
from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.simulated.laser.profiles import PROFILES
from tests.support.drivers.laser_bench import driven, next_scan, simulated_laser, wait_for

FAST = SimulatedLaserSettings(model="UTM-30LX")


@pytest.mark.parametrize(
    "left", [b"TM0\n", b"MD0000108001000\n", b"MD00001080", b"SCIP2.0\n\n\nxyz", b"BM\nGD0000", b"\xff" * 2000]
)
def test_a_laser_is_found_in_whatever_state_it_was_left(left: bytes, tmp_path: Path) -> None:
    laser = FAST.model_copy(update={"pty": str(tmp_path / "laser")})
    with simulated_laser(laser) as (device, _):
        link = SerialLink(SerialEndpoint(path=str(tmp_path / "laser"), baud=None), 115200)
        link.write(left)
        link.close()  # a serial laser does not notice, and goes on
        assert device.pty_url is not None
        with driven(LaserSettings(url=device.pty_url)) as driver:
            assert next_scan(driver).ranges_m.shape == (1081,)
            assert "bad_descriptions" not in driver.health().counters


def test_an_unknown_model_works_from_what_it_says_and_is_named_once(monkeypatch: pytest.MonkeyPatch) -> None:
    profile = PROFILES["UTM-30LX"]
    geometry = dataclasses.replace(profile.parameters, last_step=100, front_step=50, steps_per_turn=400)
    parameters = dataclasses.replace(geometry, model="XYZ-9")
    version = profile.version | {"PROD": "another product"}
    unknown = dataclasses.replace(profile, parameters=parameters, version=version)
    monkeypatch.setitem(PROFILES, "UTM-30LX", unknown)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        scan = next_scan(driver)
        device.inject({"kind": "cut", "duration_s": 0.05})
        wait_for(lambda: driver.health().counters["connections"] == 2)
        events = [event for event in driver.drain_events() if event.kind == "unknown_model"]
    assert scan.ranges_m.shape == (101,)
    assert scan.bearings_rad[-1] == pytest.approx(2 * 3.141592653589793 / 8)
    assert len(events) == 1
    assert "'XYZ-9' is not known" in events[0].reason


@pytest.mark.parametrize(
    ("field", "text", "sentence"),
    [("healthy", "Error 100 malfunction.", "it needs a reboot"), ("idle", "001 Booting", "still booting")],
)
def test_a_laser_that_is_not_well_is_named_and_tried_again(
    field: str, text: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: dict[str, Any] = {field: text}
    monkeypatch.setitem(PROFILES, "UTM-30LX", dataclasses.replace(PROFILES["UTM-30LX"], **reported))
    monkeypatch.setattr(hokuyo, "RETRY_MAX_S", 0.1)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url, reboot_on_fault=False)) as driver:
        wait_for(lambda: driver.health().counters.get("reconnects", 0) >= 2)
        health = driver.health()
    assert sentence in health.reason
    assert health.state is (SensorState.FAILED if field == "healthy" else SensorState.STARTING)


def test_a_baud_rate_that_the_laser_refuses_is_named_and_done_without(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(PROFILES, "URG-04LX", dataclasses.replace(PROFILES["URG-04LX"], bauds=(19200,)))
    laser = SimulatedLaserSettings(model="URG-04LX", pty=str(tmp_path / "laser"))
    with simulated_laser(laser) as (device, _), driven(LaserSettings(url=f"{device.pty_url}?baud=57600")) as driver:
        next_scan(driver)
        (event,) = [event for event in driver.drain_events() if event.kind == "baud_refused"]
    assert "refuses 57600 baud (status 02) and runs at 19200" in event.reason


def test_a_laser_without_time_adjustment_streams_all_the_same_and_says_so() -> None:
    with (
        simulated_laser(FAST) as (device, room),
        driven(LaserSettings(url=device.url, time_sync=False)) as driver,
    ):
        scan = next_scan(driver)
        assert driver.health().figures["clock_offset_uncertainty_ms"] > 5.0
    assert min(abs(scan.stamp_ns - sweep_ns) for sweep_ns in room.sweeps) < 10_000_000


def test_a_defect_in_the_driver_is_told_and_costs_one_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []

    def broken_once(*arguments: object) -> object:
        calls.append(1)
        if len(calls) == 1:
            raise ZeroDivisionError("a defect")
        return scan_request(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(hokuyo, "scan_request", broken_once)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        next_scan(driver)
        (event,) = [event for event in driver.drain_events() if event.kind == "defects"]
    assert "ZeroDivisionError('a defect')" in event.reason
    assert "\n" not in event.reason
