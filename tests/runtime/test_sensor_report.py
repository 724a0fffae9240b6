import json
import math

from drivers.measurements import SensorHealth, SensorState
from runtime.sensor_report import sensor_lines, sensor_object

LASER = SensorHealth(
    SensorState.FRESH,
    "",
    10.0,
    {"scans": 600, "connections": 1, "no_range_too_far": 9000, "checksum_errors": 3, "clock_wraps": 0},
    {
        "clock_offset_ms": -12.34,
        "clock_offset_uncertainty_ms": 0.52,
        "clock_drift_ppm": 19.6,
        "clock_drift_uncertainty_ppm": 2.2,
    },
    {"model": "UTM-30LX", "serial_number": "00903971", "advice": "laser.rate_hz = 15: it sends 13.3 a second"},
)


def test_a_line_names_the_device_its_clock_and_only_the_counters_of_trouble() -> None:
    (line,) = sensor_lines({"laser": sensor_object(LASER)})
    assert line.startswith("laser     fresh at 10.00 Hz; model UTM-30LX; serial number 00903971; advice laser.rate_hz")
    assert line.endswith("clock offset -12.3 +- 0.5 ms, drift 20 +- 2 ppm; 3 checksum errors")


def test_a_figure_that_is_not_known_yet_is_null_and_left_out_of_the_line() -> None:
    health = SensorHealth(SensorState.STARTING, "connecting", 0.0, {}, {"clock_offset_uncertainty_ms": math.inf})
    told = sensor_object(health)
    assert json.loads(json.dumps(told, allow_nan=False))["figures"] == {"clock_offset_uncertainty_ms": None}
    assert sensor_lines({"laser": told}) == ["laser     starting at 0.00 Hz"]
