"""Which request gives the scans that the configuration wants, from what the laser says it can do."""

import math

from drivers.scip.commands import ScanRequest
from drivers.scip.model import Parameters
from drivers.settings.laser import LaserSettings

LONGEST_INTERVAL = 9  # one digit in the request
RATE_TOLERANCE = 0.05  # beyond it a rate is not the one that was asked for


def scan_request(settings: LaserSettings, parameters: Parameters) -> tuple[ScanRequest, dict[str, str]]:
    """The request for an endless stream, and a sentence for each wish that the laser cannot fulfil, by its kind."""
    first, last = parameters.first_step, parameters.last_step
    low_deg, high_deg = settings.angle_min_deg, settings.angle_max_deg
    # a billionth of a step forgives the rounding of degrees to radians
    wanted_first = first if low_deg is None else math.ceil(_step(low_deg, parameters) - 1e-9)
    wanted_last = last if high_deg is None else math.floor(_step(high_deg, parameters) + 1e-9)
    warnings = {}
    is_outside = max(first, wanted_first) > min(last, wanted_last)
    if wanted_first < first or wanted_last > last:
        lowest, highest = (math.degrees(parameters.bearing_rad(step)) for step in (first, last))
        warnings["angles"] = (
            f"laser.angle_min_deg = {settings.angle_min_deg}, angle_max_deg = {settings.angle_max_deg}: "
            f"{parameters.model} sees from {lowest:.1f} to {highest:.1f}; "
            f"{'this range holds no beam, so all are used' if is_outside else 'only the beams within both are used'}"
        )
    clamped_first, clamped_last = (first, last) if is_outside else (max(first, wanted_first), min(last, wanted_last))
    interval = max(0, min(LONGEST_INTERVAL, round(1.0 / (parameters.period_s * settings.rate_hz)) - 1))
    rate_hz = 1.0 / (parameters.period_s * (interval + 1))
    if abs(rate_hz / settings.rate_hz - 1.0) > RATE_TOLERANCE:
        warnings["rate"] = (
            f"laser.rate_hz = {settings.rate_hz:g}: {parameters.model} turns {1.0 / parameters.period_s:g} "
            f"times a second and can skip at most {LONGEST_INTERVAL} scans in a row; it sends {rate_hz:.1f} "
            "a second"
        )
    return ScanRequest(settings.command, clamped_first, clamped_last, settings.cluster, interval), warnings


def _step(angle_deg: float, parameters: Parameters) -> float:
    """The inverse of Parameters.bearing_rad."""
    return parameters.front_step + math.radians(angle_deg) / parameters.step_rad
