"""Whatever state a laser was left in, and whatever it says of itself, over the real wire."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drivers.laser import handshake, hokuyo, time_adjustment
from drivers.laser.link import SerialLink
from drivers.laser.request import scan_request
from drivers.measurements import SensorState
from drivers.scip.codec import StatusError, decode_number, encode_message, encode_number, encode_time, summed
from drivers.settings.laser import LaserSettings, SerialEndpoint
from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.simulated.laser.profiles import PROFILES
from drivers.simulated.laser.protocol import LaserProtocol, Sweep
from tests.support.drivers.laser_bench import driven, next_scan, simulated_laser, wait_for
from tests.support.drivers.raising import raise_in

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
    assert "'XYZ-9' is unknown" in events[0].reason


def odd(monkeypatch: pytest.MonkeyPatch, change: Callable[[bytes, bytes], bytes]) -> None:
    """The simulated laser's answers to VV, PP, II and TM pass through a change."""
    true_reply = LaserProtocol.reply

    def reply(self: LaserProtocol, line: bytes, now_ns: int) -> bytes:
        answer = true_reply(self, line, now_ns)
        return change(line, answer) if line[:2] in (b"VV", b"PP", b"II", b"TM") else answer

    monkeypatch.setattr(LaserProtocol, "reply", reply)


def without(commands: bytes) -> Callable[[bytes, bytes], bytes]:
    return lambda line, answer: b"" if line in commands.split() else answer


def garbled(command: bytes, pattern: bytes, by: bytes) -> Callable[[bytes, bytes], bytes]:
    return lambda line, answer: re.sub(pattern, by, answer) if line == command else answer


ODD = {
    "VV and II silent": without(b"VV II"),
    "a wrong checksum in VV": garbled(b"VV", rb"(SERI:[^;]*;).", rb"\1~"),
    "no colon in II": garbled(b"II", rb"STAT:", b"STAT "),
    "bytes that are no text": garbled(b"VV", rb"VEND:", b"VEND:\xff\x1b[31m\x07"),
    "no status in VV": garbled(b"VV", rb"00P", b"0"),
    "the same wrong checksum in PP each time": garbled(b"PP", rb"(MODL:[^;]*;).", rb"\1~"),
    "a blank after DMIN": garbled(b"PP", rb"DMIN:23;7", b"DMIN: 23;W"),
    "a ninth line in PP": garbled(b"PP", rb"(SCAN:2400;U\n)", rb"\1PROT:SCIP 2.2;P\n"),
    "a failure predicted": garbled(b"II", rb"STAT:[^\n]*", b"STAT:Failure predicted;0"),
    "TM silent": without(b"TM0 TM1 TM2"),
}


@pytest.mark.parametrize("kind", ODD)
def test_what_is_not_needed_is_not_required(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    odd(monkeypatch, ODD[kind])
    monkeypatch.setattr(handshake, "REPLY_TIMEOUT_S", 0.15)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        scan = next_scan(driver)
        health = driver.health()
    assert np.isfinite(scan.ranges_m).any()
    assert health.state is SensorState.FRESH
    assert (health.counters.get("reboots", 0), health.counters.get("reconnects", 0)) == (0, 0)
    assert all(text.isprintable() for text in health.facts.values())
    if "failure" in kind:
        assert "reports 'Failure predicted'" in health.facts["advice"]


def test_a_laser_that_complains_and_does_not_measure_is_named_and_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    profile = dataclasses.replace(PROFILES["UTM-30LX"], healthy="Error 100 malfunction.")
    monkeypatch.setitem(PROFILES, "UTM-30LX", profile)
    monkeypatch.setattr(hokuyo, "RETRY_MAX_S", 0.1)
    true_answer = LaserProtocol._answer

    def refusing(self: LaserProtocol, name: str, text: str, line: bytes, now_ns: int) -> bytes:
        if name == "MD":
            raise StatusError("MD", "10")
        return true_answer(self, name, text, line, now_ns)

    monkeypatch.setattr(LaserProtocol, "_answer", refusing)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url, reboot_on_fault=False)) as driver:
        wait_for(lambda: driver.health().counters.get("reconnects", 0) >= 1)
        health = driver.health()
    assert health.state is SensorState.FAILED
    assert "'Error 100 malfunction.' and does not measure; it needs a reboot" in health.reason


def test_a_laser_that_boots_is_waited_for_but_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROFILES, "UTM-30LX", dataclasses.replace(PROFILES["UTM-30LX"], idle="001 Booting"))
    monkeypatch.setattr(hokuyo, "RETRY_MAX_S", 0.1)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        wait_for(lambda: "still booting" in driver.health().reason)
        assert driver.health().state is SensorState.STARTING
        monkeypatch.setattr(handshake, "BOOT_NS", 0)
        next_scan(driver)


def in_microseconds(answer: bytes) -> bytes:
    """What firmware that tells microseconds makes of a reply to a command behind a %: 417 of them more."""
    lines = answer.split(b"\n")
    if len(lines[2]) == 5 and lines[1] in (b"00P", b"99b"):
        lines[2] = summed(encode_number(decode_number(lines[2][:-1]) * 1000 + 417, 11))[:-1]
    return b"%" + b"\n".join(lines)


@pytest.mark.parametrize("knows_scans", [True, False])
def test_microseconds_are_used_where_firmware_tells_them(knows_scans: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    true_reply, true_scan = LaserProtocol.reply, LaserProtocol.scan
    marked: set[int] = set()

    def reply(self: LaserProtocol, line: bytes, now_ns: int) -> bytes:
        if not line.startswith((b"%TM", b"%MD")):
            marked.discard(id(self))
            return true_reply(self, line, now_ns)
        if line.startswith(b"%MD") and not knows_scans:
            return encode_message(line, "0E")
        marked.add(id(self))
        return in_microseconds(true_reply(self, line[1:], now_ns))

    def scan(self: LaserProtocol, sweep: Sweep, missing_steps: int = 0) -> bytes:
        message = true_scan(self, sweep, missing_steps)
        return in_microseconds(message) if id(self) in marked else message

    monkeypatch.setattr(LaserProtocol, "reply", reply)
    monkeypatch.setattr(LaserProtocol, "scan", scan)
    laser = SimulatedLaserSettings(model="UST-10LX")
    with simulated_laser(laser) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        next_scan(driver)
        health = driver.health()
        assert driver._time.in_microseconds is knows_scans
    assert health.state is SensorState.FRESH
    assert health.counters.get("framing_errors", 0) == 0


@pytest.mark.parametrize("counter_ms", [5, 9_000_000])
def test_a_clock_that_is_not_that_of_the_scans_is_given_up_and_said(
    monkeypatch: pytest.MonkeyPatch, counter_ms: int
) -> None:
    def other_clock(line: bytes, answer: bytes) -> bytes:
        return b"TM1\n00P\n" + encode_time(counter_ms) + b"\n" if line == b"TM1" else answer

    odd(monkeypatch, other_clock)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        for _ in range(20):
            next_scan(driver)
        health = driver.health()
    assert health.counters["stream_restarts"] <= 3
    assert "is not that of its scans" in health.facts["advice"]
    assert health.state is SensorState.FRESH


def test_a_laser_that_does_not_answer_qt_streams_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    odd(monkeypatch, lambda line, answer: b"" if line == b"QT" else answer)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        next_scan(driver)


def test_a_laser_that_refuses_tm_while_it_boots_is_asked_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []

    def refused_once(line: bytes, answer: bytes) -> bytes:
        asked.extend([line] if line == b"TM0" else [])
        return b"TM0\n10Q\n\n" if line == b"TM0" and len(asked) == 1 else answer

    odd(monkeypatch, refused_once)
    monkeypatch.setattr(time_adjustment, "SECOND_TRY_NS", 100_000_000)
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        wait_for(lambda: driver.health().figures["clock_offset_uncertainty_ms"] < 5.0)
        next_scan(driver)
        assert driver.health().counters["clock_checks"] == 1
    assert asked == [b"TM0", b"TM0"]


def test_the_thread_outlives_whatever_is_raised_in_it() -> None:
    with simulated_laser(FAST) as (device, _), driven(LaserSettings(url=device.url)) as driver:
        for kill in range(2):
            next_scan(driver)
            raise_in("laser")
            wait_for(lambda kills=kill: driver.health().counters.get("defects", 0) > kills)  # type: ignore[misc]
            driver.latest()
            next_scan(driver)
        assert any("OutOfNowhere" in event.reason for event in driver.drain_events())


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
