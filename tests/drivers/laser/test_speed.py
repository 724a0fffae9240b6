"""How long the laser takes: figures of the acceptance table, run by `make bench`."""

import sys
import time

import numpy as np
import pytest

from drivers.events import EventLog
from drivers.laser.clock import LaserClock
from drivers.laser.scans import ScanAssembly
from drivers.scip.commands import ScanRequest
from drivers.scip.framing import MessageStream
from drivers.scip.scan import ScanDecoder, encode_characters, encode_scan
from drivers.settings.laser import LaserSettings
from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.simulated.laser.ports import Wire
from drivers.simulated.laser.profiles import PROFILES
from tests.support.drivers.laser_bench import driven, next_scan, simulated_laser

REQUEST = ScanRequest("MD", 0, 1080)
PERIOD_NS = 100_000_000


def report(line: str) -> None:
    sys.stdout.write(f"\n{line}\n")


def messages(count: int) -> list[bytes]:
    rng = np.random.default_rng(0)
    found = []
    for number in range(count):
        codes = rng.integers(0, 20000, 1081).astype(np.int32)
        codes[:40] = 1
        characters = encode_characters(codes, 3).tobytes()
        found.append(encode_scan(REQUEST.encode(), "99", 100 * number, characters))
    return found


@pytest.mark.bench
def test_a_scan_is_decoded_in_a_hundred_microseconds() -> None:
    decoder, times_us = ScanDecoder(REQUEST), []
    for raw in messages(500):
        began_ns = time.perf_counter_ns()
        decoder.decode(raw[:-2])
        times_us.append((time.perf_counter_ns() - began_ns) * 1e-3)
    report(f"decode, sums checked: median {np.median(times_us):.1f} us, p99 {np.percentile(times_us, 99):.1f} us")
    assert np.median(times_us) < 100.0


@pytest.mark.bench
def test_a_message_becomes_a_scan_without_holding_the_interpreter_for_long() -> None:
    parameters = PROFILES["UTM-X001S"].parameters
    events = EventLog("laser")
    assembly = ScanAssembly(LaserSettings(), parameters, REQUEST, LaserClock(200.0), events, {})
    stream, times_us = MessageStream(), []
    for number, raw in enumerate(messages(500)):
        began_ns = time.perf_counter_ns()
        (message,) = stream.feed(number * PERIOD_NS + 75_000_000, raw)
        assert assembly.take(message) is not None
        times_us.append((time.perf_counter_ns() - began_ns) * 1e-3)
    report(f"bytes to Scan: median {np.median(times_us):.1f} us, p99 {np.percentile(times_us, 99):.1f} us")
    assert np.median(times_us) < 200.0


@pytest.mark.bench
def test_a_scan_is_ready_ten_milliseconds_after_its_first_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    sent_ns: list[int] = []
    send = Wire.send

    def send_and_note(wire: Wire, data: bytes) -> None:
        if len(data) > 3000:
            sent_ns.append(time.monotonic_ns())
        send(wire, data)

    monkeypatch.setattr(Wire, "send", send_and_note)
    laser = SimulatedLaserSettings(model="UTM-30LX")
    delays_ms = []
    with simulated_laser(laser) as (device, _), driven(LaserSettings(url=device.url, rate_hz=40.0)) as driver:
        next_scan(driver)
        for _ in range(400):
            scan = driver.latest()
            while scan is None:
                time.sleep(0.0005)  # as often as the measurement needs
                scan = driver.latest()
            delays_ms.append((time.monotonic_ns() - sent_ns[-1]) * 1e-6)
    report(f"first byte to Scan: median {np.median(delays_ms):.2f} ms, p99 {np.percentile(delays_ms, 99):.2f} ms")
    assert np.percentile(delays_ms, 99) < 10.0
