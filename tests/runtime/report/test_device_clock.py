import numpy as np
import pytest

from drivers.scip.codec import COUNTER_MS, encode_time
from runtime.messages.tick import LaserBytes, Record, encode_laser_bytes
from runtime.report.device_clock import DeviceClockReader

PERIOD_MS = 25


def read(counters_ms: list[int]) -> tuple[list[float], list[float]]:
    """Arrival s and unwrapped counter s of scans that come every 25 ms."""
    clock = DeviceClockReader()
    for k, counter_ms in enumerate(counters_ms):
        data = b"MD0000108001000\n99b\n" + encode_time(counter_ms) + b"\n"
        clock.feed(encode_laser_bytes(LaserBytes(k * PERIOD_MS * 1_000_000, False, data)).data)
    columns = clock.columns(0)
    return columns.arrival_s.tolist(), columns.device_s.tolist()


def test_the_counter_grows_on_through_its_wrap() -> None:
    first_ms = COUNTER_MS - 60
    arrival_s, device_s = read([(first_ms + k * PERIOD_MS) % COUNTER_MS for k in range(6)])
    assert np.subtract(device_s, arrival_s) == pytest.approx(np.full(6, first_ms * 1e-3))


def test_a_device_that_began_anew_late_in_its_counter_is_no_wrap() -> None:
    counters_ms = [COUNTER_MS - 5_000_000 + k * PERIOD_MS for k in range(3)] + [0, 25, 50]
    _, device_s = read(counters_ms)
    assert device_s == pytest.approx([counter_ms * 1e-3 for counter_ms in counters_ms])


def test_bytes_to_the_laser_are_not_read() -> None:
    clock = DeviceClockReader()
    record: Record = encode_laser_bytes(LaserBytes(0, True, b"MD\n99b\n" + encode_time(5) + b"\n"))
    clock.feed(record.data)
    assert clock.columns(0).arrival_s.size == 0
