"""The laser's own clock as its raw bytes tell it: the counter of each scan against its arrival."""

import re

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, ProtocolError
from drivers.scip.codec import parse_time
from runtime.messages.tick import Record, decode_laser_bytes
from runtime.report.facts import DeviceClock

SCAN_HEAD = re.compile(rb"\n99b\n([^\n]{5})\n")  # status line of a streamed scan, then its counter with a check sum
WRAP_MS = 1 << 24


class DeviceClockReader:
    """Takes raw laser records in order; a counter that is torn between two reads is left out."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int]] = []

    def feed(self, record: Record) -> None:
        """One record of /raw/laser."""
        raw = decode_laser_bytes(record.data)
        if raw.sent:
            return
        for found in SCAN_HEAD.finditer(raw.data):
            try:
                self._rows.append((raw.stamp_ns, parse_time(found.group(1))))
            except ProtocolError:
                continue  # a damaged counter tells nothing of the clock; damage is counted by the driver

    def columns(self, origin_ns: int) -> DeviceClock:
        """Arrival s since origin_ns and counter s, (n,) each; the counter's wrap at 2^24 ms is taken out."""
        table = np.array(self._rows, dtype=np.int64).reshape(-1, 2)
        steps = np.diff(table[:, 1], prepend=table[:1, 1])
        wraps: NDArray[np.int64] = np.cumsum(steps < -WRAP_MS // 2) - np.cumsum(steps > WRAP_MS // 2)
        arrival_s: FloatArray = (table[:, 0] - origin_ns) * np.float64(1e-9)
        device_s: FloatArray = (table[:, 1] + wraps * WRAP_MS) * np.float64(1e-3)
        return DeviceClock(arrival_s, device_s)
