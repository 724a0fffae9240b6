import socket
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.canbus.frame import EXTENDED, CanFrame
from drivers.measurements import LinkError, SensorHealth, SensorState
from drivers.settings.can import BusSettings
from runtime.settings.configuration import load_configuration_text
from runtime.setup.check_result import Check, CheckResult, worst_result
from runtime.setup.preflight import (
    check_bus,
    check_calibration,
    check_clock,
    check_compile_cache,
    check_disk,
    check_endpoint,
    check_real_time,
    judge_sensor,
)

PASS, WARN, FAIL = CheckResult


def finding(verdict: CheckResult) -> Check:
    return Check("x", verdict, "")


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ([], PASS),
        ([PASS, WARN], WARN),
        (list(CheckResult), FAIL),
    ],
)
def test_the_worst_finding_is_the_result(verdicts: list[CheckResult], expected: CheckResult) -> None:
    assert worst_result([finding(verdict) for verdict in verdicts]) is expected


def test_a_clock_that_was_never_set_is_a_warning_with_a_remedy() -> None:
    found = check_clock(86400.0)
    assert found.verdict is WARN
    assert "1970-01-02" in found.reason
    assert "timedatectl" in found.remedy
    assert check_clock(2e9).verdict is PASS


@pytest.mark.parametrize(("free_bytes", "expected"), [(1e8, FAIL), (1e9, WARN), (1e11, PASS)])
def test_disk_space_is_judged_in_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free_bytes: float, expected: CheckResult
) -> None:
    usage = SimpleNamespace(total=2e11, used=2e11 - free_bytes, free=free_bytes)
    monkeypatch.setattr("runtime.setup.preflight.shutil.disk_usage", lambda _path: usage)
    found = check_disk(tmp_path / "runs" / "not-there-yet")
    assert found.verdict is expected
    assert "hours" in found.reason


def test_compiling_is_told_while_it_lasts_and_no_warning_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    def compiled(_settings: object, tell: Callable[[str], None], _stop: object) -> float:
        tell("starting: compiling kernels 3 of 9")
        return 240.0

    monkeypatch.setattr("runtime.live.kernels.load_kernels", compiled)
    told: list[str] = []
    found = check_compile_cache(load_configuration_text(""), told.append)
    assert told == ["starting: compiling kernels 3 of 9"]
    assert (found.verdict, found.remedy) == (PASS, "")
    assert "compiled just now, in 240 s" in found.reason


def test_a_priority_that_is_not_allowed_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.setup.preflight.os.geteuid", lambda: 1000)
    monkeypatch.setattr("runtime.setup.preflight.resource.getrlimit", lambda _limit: (0, 0))
    found = check_real_time(50)
    assert found.verdict is WARN
    assert "LimitRTPRIO" in found.remedy
    assert check_real_time(0).verdict is WARN


def test_wheels_measured_by_ruler_ask_for_a_calibration_and_calibrated_ones_do_not() -> None:
    by_ruler = "[vehicle]\nwheel_radius_left_m = 0.0825\nwheel_radius_right_m = 0.0825\ntread_m = 0.42\n"
    assert check_calibration(load_configuration_text(by_ruler)).verdict is WARN
    radii_only = by_ruler + "[slam.odometry]\nradius_uncertainty = 0.002\n"
    assert check_calibration(load_configuration_text(radii_only)).verdict is WARN
    assert check_calibration(load_configuration_text(radii_only + "tread_uncertainty = 0.002")).verdict is PASS


def test_a_taken_port_is_a_warning() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert check_endpoint(f"tcp/127.0.0.1:{port}").verdict is WARN
    assert check_endpoint(f"tcp/127.0.0.1:{port}").verdict is PASS


def test_a_silent_sensor_fails_and_a_slow_one_warns() -> None:
    assert judge_sensor("laser", SensorHealth(SensorState.STARTING, "no answer", 0.0), 10.0).verdict is FAIL
    assert judge_sensor("laser", SensorHealth(SensorState.FRESH, "", 5.0), 10.0).verdict is WARN
    assert judge_sensor("laser", SensorHealth(SensorState.FRESH, "", 9.98), 10.0).verdict is PASS


def down(_bus: BusSettings, _seconds: float) -> list[CanFrame]:
    raise LinkError("can0 is down; ip link set can0 up")


def test_where_the_wheels_are_not_heard_the_ids_that_are_say_what_would_fit() -> None:
    bus = BusSettings(interface="socketcan", channel="can0")
    sent = [(k * 20_000_000, 27 << 8 | node, bytes((k, *range(7)))) for k in range(50) for node in (1, 2)]
    vesc = [CanFrame(*each, EXTENDED) for each in sent]
    told = check_bus(bus, lambda _bus, _seconds: vesc)
    assert (told.verdict, "0x00001B01 (50 frames)" in told.reason) == (CheckResult.WARN, True)
    assert "VESC fits" in told.remedy
    strange = check_bus(bus, lambda _bus, _seconds: [CanFrame(0, number, b"a") for number in range(20)])
    assert "8 more ids" in strange.reason
    assert "encoders.layout" in strange.remedy
    assert "nothing was heard" in check_bus(bus, lambda _bus, _seconds: []).reason
    assert (check_bus(bus, down).reason, check_bus(bus, down).remedy) == ("can0 is down", "ip link set can0 up")


def test_a_remedy_is_told_once_and_is_that_of_the_driver_where_it_has_one() -> None:
    """It was followed by another one: "check the port in laser.url; check power, cable and configuration"."""
    for reason, remedy in (("no answer", "check power, cable and configuration"), ("nothing listens; wait", "wait")):
        told = judge_sensor("laser", SensorHealth(SensorState.STARTING, reason, 0.0), 10.0)
        assert (told.reason, told.remedy) == (f"starting: {reason.partition(';')[0]}", remedy)
