"""The laser's own clock as its raw bytes tell it: the counter of each scan against its arrival."""

from array import array

import numpy as np

from drivers.laser.timing.counter import CounterUnwrap
from drivers.measurements import FloatArray
from drivers.scip.scan import scan_counters_ms
from runtime.messages.tick import decode_laser_bytes
from runtime.report.facts import DeviceClock


class DeviceClockReader:
    """Takes raw laser records in order; a counter that is torn between two reads is left out."""

    def __init__(self) -> None:
        self._counter = CounterUnwrap()
        self._rows = array("q")  # arrival ns and counter ms by turns

    def feed(self, data: bytes) -> None:
        """One record of /raw/laser. Raises ValueError where it is none."""
        raw = decode_laser_bytes(data)
        for counter_ms in () if raw.sent else scan_counters_ms(raw.data):
            self._counter.take(counter_ms, raw.stamp_ns)
            self._rows.extend((raw.stamp_ns, self._counter.total_ms))

    def columns(self, origin_ns: int) -> DeviceClock:
        """Arrival s since origin_ns and unwrapped counter s, (n,) each; the counter falls where it restarted."""
        table = np.array(self._rows).reshape(-1, 2)
        arrival_s: FloatArray = (table[:, 0] - origin_ns) * np.float64(1e-9)
        device_s: FloatArray = table[:, 1] * np.float64(1e-3)
        return DeviceClock(arrival_s, device_s)
