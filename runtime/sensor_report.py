"""What a sensor says of itself, for status, summary and a person: counters by reason, figures and facts."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from runtime.printable import printable

if TYPE_CHECKING:
    from drivers.measurements import SensorHealth

USUAL = ("scans", "connections", "bus.sessions")  # counters that grow when all is well
USUAL_PREFIX = "no_range_"  # beams that met nothing
NAMED = ("model", "firmware", "serial_number", "advice")


def sensor_object(sensor: "SensorHealth") -> dict[str, Any]:
    """One sensor as JSON can hold it: a figure that is not known yet is null."""
    figures = {key: round(value, 4) if math.isfinite(value) else None for key, value in sensor.figures.items()}
    return {
        "state": sensor.state.value,
        "reason": printable(sensor.reason),
        "rate_hz": round(sensor.rate_hz, 2),
        "counters": dict(sensor.counters),
        "figures": figures,
        "facts": {key: printable(value) for key, value in sensor.facts.items()},
    }


def sensor_lines(sensors: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """One line a sensor: which it is, its clock, and everything that went wrong with its count."""
    return [f"{name:9s} {_line(sensor)}" for name, sensor in sensors.items()]


def _line(sensor: Mapping[str, Any]) -> str:
    facts, figures, counters = sensor.get("facts", {}), sensor.get("figures", {}), sensor.get("counters", {})
    parts = [f"{sensor['state']} at {sensor['rate_hz']:.2f} Hz"]
    parts += [f"{key.replace('_', ' ')} {facts[key]}" for key in NAMED if facts.get(key)]
    if figures.get("clock_offset_uncertainty_ms") is not None:
        parts.append(
            f"clock offset {figures['clock_offset_ms']:.1f} +- {figures['clock_offset_uncertainty_ms']:.1f} ms, "
            f"drift {figures['clock_drift_ppm']:.0f} +- {figures['clock_drift_uncertainty_ppm']:.0f} ppm"
        )
    unusual = {key: n for key, n in counters.items() if n and key not in USUAL and not key.startswith(USUAL_PREFIX)}
    parts += [f"{count} {key.replace('_', ' ')}" for key, count in sorted(unusual.items())]
    return "; ".join(parts)
