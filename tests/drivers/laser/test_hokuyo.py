import os
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.measurements import SensorState
from drivers.settings.laser import LaserSettings
from drivers.settings.simulated_laser import FaultKind, LaserFault, LaserModel, SimulatedLaserSettings
from tests.support.drivers.laser_bench import driven, next_scan, simulated_laser, wait_for

FAST = SimulatedLaserSettings(model="UTM-30LX")


def test_scans_arrive_with_true_ranges_bearings_and_stamps() -> None:
    with simulated_laser(SimulatedLaserSettings()) as (device, room), driven(LaserSettings(url=device.url)) as driver:
        scans = [next_scan(driver) for _ in range(4)]
    for scan in scans:
        assert scan.ranges_m.shape == (1081,)
        assert np.isnan(scan.ranges_m[0])  # nothing there is no distance
        assert np.nanmax(np.abs(scan.ranges_m - 5.0)) < 0.1
        assert np.degrees(scan.bearings_rad[[0, 540, -1]]) == pytest.approx([-135.0, 0.0, 135.0])
        assert np.array_equal(np.rint(scan.ranges_m[1:] * 1000) / np.float32(1000), scan.ranges_m[1:])
        assert scan.beam_period_s == pytest.approx(0.1 / 1440)
    own_sweeps = [nearest(scan.stamp_ns, room.sweeps) for scan in scans]
    assert (np.diff(own_sweeps) > 0).all(), "each scan has the stamp of its own sweep"


def nearest(stamp_ns: int, sweeps: list[int]) -> int:
    """Number of the sweep that began nearest to a stamp."""
    return int(np.argmin(np.abs(np.array(sweeps) - stamp_ns)))


@pytest.mark.bench
def test_stamps_are_true_to_two_milliseconds() -> None:
    with simulated_laser(SimulatedLaserSettings()) as (device, room), driven(LaserSettings(url=device.url)) as driver:
        stamps = [next_scan(driver).stamp_ns for _ in range(10)]
    errors_ns = [abs(stamp_ns - room.sweeps[nearest(stamp_ns, room.sweeps)]) for stamp_ns in stamps]
    assert max(errors_ns) < 2_000_000
    assert np.diff(stamps) == pytest.approx(100_000_000, abs=2_500_000)


@pytest.mark.parametrize(
    ("model", "steps", "field_deg"),
    [
        *(("UTM-30LX-EW", 1081, 270.0), ("UST-10LX", 1081, 270.0), ("UST-20LX", 1081, 270.0)),
        *(("URG-04LX", 682, 239.4), ("UXM-30LX-E", 761, 190.0)),
    ],
)
def test_every_model_is_known_from_what_it_says(model: LaserModel, steps: int, field_deg: float) -> None:
    settings = SimulatedLaserSettings(model=model)
    with simulated_laser(settings) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        scan = next_scan(driver)
        health = driver.health()
    assert scan.ranges_m.shape == (steps,)
    assert np.degrees(np.ptp(scan.bearings_rad)) == pytest.approx(field_deg, abs=0.1)
    assert health.facts["model"].startswith(model)
    assert np.isnan(scan.ranges_m[0])
    assert health.state is SensorState.FRESH
    assert "unknown_model" not in health.counters


def test_ten_scans_a_second_are_asked_of_a_sensor_that_makes_forty() -> None:
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        stamps = [next_scan(driver).stamp_ns for _ in range(12)]
    assert set(np.rint(np.diff(stamps) / 25e6) % 4) == {0}, "every fourth sweep, however late this test looks"


@pytest.mark.parametrize("command", ["ME", "ND", "NE", "MS"])
def test_intensity_and_echoes_are_read(command: str) -> None:
    laser = SimulatedLaserSettings(model="UTM-30LX-EW")
    with simulated_laser(laser) as (device, _):
        echo = "last" if command in ("ND", "NE") else "first"
        settings = LaserSettings.model_validate({"url": device.url, "command": command, "echo": echo})
        with driven(settings) as driver:
            scan = next_scan(driver)
    if command == "MS":
        assert np.isnan(scan.ranges_m).all()  # 5 m is beyond what two characters hold
        assert scan.range_max_m == pytest.approx(4.094)
    else:
        assert np.nanmax(np.abs(scan.ranges_m - 5.0)) < 0.1


def test_an_angle_window_with_clusters_looks_where_it_says() -> None:
    with simulated_laser(FAST) as (device, _):
        settings = LaserSettings(url=device.url, angle_min_deg=-45.0, angle_max_deg=200.0 - 110.0, cluster=3)
        with driven(settings) as driver:
            scan = next_scan(driver)
            health = driver.health()
    assert scan.ranges_m.shape == (181,)
    assert np.degrees(scan.bearings_rad[0]) == pytest.approx(-44.75)  # the middle of the first three steps
    assert np.degrees(np.diff(scan.bearings_rad)) == pytest.approx(0.75)
    assert "angles" not in health.counters


def test_angles_that_the_model_does_not_have_are_clamped_and_told_once() -> None:
    with (
        simulated_laser(FAST) as (device, _),
        driven(LaserSettings(url=device.url, angle_min_deg=-170.0)) as driver,
    ):
        scan = next_scan(driver)
        events, advice = driver.drain_events(), driver.health().facts["advice"]
    assert scan.ranges_m.shape == (1081,)
    (event,) = [event for event in events if event.kind == "angles"]
    assert advice == event.reason
    assert "sees from -135.0 to 135.0" in event.reason


def test_silence_is_stale_and_ends_with_the_fault() -> None:
    with simulated_laser(SimulatedLaserSettings()) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        next_scan(driver)
        device.inject(LaserFault(kind=FaultKind.SILENCE, duration_s=3.0))
        wait_for(lambda: driver.health().state is SensorState.STALE)
        assert driver.health().reason.startswith("no scan:")
        wait_for(lambda: driver.health().state is SensorState.FRESH)
        assert driver.health().counters["silences"] >= 1


def test_a_serial_laser_is_found_at_whatever_rate_it_speaks(tmp_path: Path) -> None:
    laser = SimulatedLaserSettings(model="URG-04LX", pty=str(tmp_path / "laser"))
    with simulated_laser(laser) as (device, _):
        assert device.pty_url is not None
        with driven(LaserSettings(url=device.pty_url)) as driver:
            scan = next_scan(driver)
        assert scan.ranges_m.shape == (682,)
        with driven(LaserSettings(url=f"{device.pty_url}?baud=115200")) as driver:
            next_scan(driver)


def test_a_serial_laser_comes_back_after_its_cable_was_pulled(tmp_path: Path) -> None:
    laser = SimulatedLaserSettings(pty=str(tmp_path / "laser"))
    with simulated_laser(laser) as (device, _):
        assert device.pty_url is not None
        with driven(LaserSettings(url=device.pty_url)) as driver:
            next_scan(driver)
            device.inject({"kind": "cut", "duration_s": 0.3})
            wait_for(lambda: driver.health().counters.get("link_errors", 0) > 0)
            before = driver.health().counters["scans"]
            wait_for(lambda: driver.health().counters["scans"] > before)


def test_stamps_go_on_over_a_wrap_of_the_counter_and_over_a_power_cycle() -> None:
    laser = SimulatedLaserSettings(model="UTM-30LX", clock_start_ms=2**24 - 900, boot_s=0.1, skew_ppm=50.0)
    stamps, sweeps = [], []
    with simulated_laser(laser) as (device, room), driven(LaserSettings(url=device.url)) as driver:
        for number in range(22):
            scan = next_scan(driver)
            stamps.append(scan.stamp_ns)
            sweeps.append(nearest(scan.stamp_ns, room.sweeps))
            if number == 11:
                assert driver.health().counters["clock_wraps"] == 1
                device.inject({"kind": "power_cycle"})
                wait_for(lambda: driver.health().counters.get("link_errors", 0) > 0)
        counters = driver.health().counters
    assert np.all(np.diff(stamps) > 0)
    assert np.all(np.diff(sweeps) > 0)
    assert counters["clock_restarts"] == 1
    assert counters["clock_wraps"] == 1


class ByteCount:
    """A tap that counts."""

    def __init__(self) -> None:
        self.bytes = 0

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        self.bytes += len(data)

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        raise AssertionError


def test_bytes_are_recorded_always_or_only_around_an_error() -> None:
    always, around = ByteCount(), ByteCount()
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url), always) as driver:
        next_scan(driver)
    assert always.bytes > 3372
    with (
        simulated_laser(FAST) as (device, _),
        driven(LaserSettings(url=device.url), around, raw_around_errors=True) as driver,
    ):
        next_scan(driver)
        next_scan(driver)
        assert around.bytes == 0
        device.inject({"kind": "bad_checksum", "duration_s": 0.2})
        wait_for(lambda: around.bytes > 3 * 3372)  # those before the error are among them


def trouble_with(url: str) -> str:
    """The one sentence that the driver says of a laser that cannot be used."""
    with driven(LaserSettings(url=url)) as driver:
        wait_for(lambda: driver.health().reason != f"connecting to {url}")
        health = driver.health()
    assert health.state is SensorState.STARTING
    assert "\n" not in health.reason
    return health.reason


def test_a_port_where_nothing_listens_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert f"nothing listens at 127.0.0.1:{port}" in trouble_with(f"tcp://127.0.0.1:{port}")


def test_a_device_file_that_is_absent_is_named(tmp_path: Path) -> None:
    assert "does not exist" in trouble_with(f"serial://{tmp_path}/laser")


@pytest.mark.skipif(os.getuid() == 0, reason="root has permission on everything")
def test_a_device_file_without_permission_names_the_group(tmp_path: Path) -> None:
    path = tmp_path / "laser"
    path.touch(0o060)
    assert "add this user to the group" in trouble_with(f"serial://{path}")


def test_a_file_that_is_no_serial_port_is_named(tmp_path: Path) -> None:
    path = tmp_path / "laser"
    path.touch()
    assert "check that it is a serial port" in trouble_with(f"serial://{path}")


def test_a_port_that_does_not_speak_scip_is_told_from_a_silent_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        stop = threading.Event()

        def greet() -> None:
            server.settimeout(0.1)
            while not stop.is_set():
                try:
                    client, _ = server.accept()
                except TimeoutError:
                    continue
                with client:
                    client.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")
                    stop.wait(2.0)

        thread = threading.Thread(target=greet)
        thread.start()
        try:
            reason = trouble_with(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        finally:
            stop.set()
            thread.join()
    assert "which is not SCIP" in reason
    assert "SSH-2.0" in reason
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert "open but silent" in trouble_with(f"tcp://127.0.0.1:{server.getsockname()[1]}")


def test_closing_ends_the_thread_whatever_the_driver_is_doing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, simulated_laser(FAST) as (device, _):
        for url in (f"tcp://127.0.0.1:{server.getsockname()[1]}", "tcp://127.0.0.1:1", device.url):
            with driven(LaserSettings(url=url)):
                time.sleep(0.02)
    wait_for(lambda: not [thread for thread in threading.enumerate() if thread.name == "laser"])
