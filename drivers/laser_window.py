"""Which request gives the scans that the configuration wants, from what the laser says it can do."""

import math

from drivers.laser_settings import LaserSettings
from drivers.scip_commands import ScanRequest
from drivers.scip_model import Parameters

LONGEST_INTERVAL = 9  # one digit in the request


def scan_request(settings: LaserSettings, parameters: Parameters) -> tuple[ScanRequest, str]:
    """The request for an endless stream, and a sentence about angles that the laser does not have, "" if it has all."""
    first, last = parameters.first_step, parameters.last_step
    low_deg, high_deg = settings.angle_min_deg, settings.angle_max_deg
    # a billionth of a step forgives the rounding of degrees to radians
    wanted_first = first if low_deg is None else math.ceil(_step(low_deg, parameters) - 1e-9)
    wanted_last = last if high_deg is None else math.floor(_step(high_deg, parameters) + 1e-9)
    warning = ""
    if wanted_first < first or wanted_last > last:
        lowest, highest = (math.degrees(parameters.bearing_rad(step)) for step in (first, last))
        warning = (
            f"laser.angle_min_deg = {settings.angle_min_deg}, angle_max_deg = {settings.angle_max_deg}: "
            f"{parameters.model} sees from {lowest:.1f} to {highest:.1f}; only these are used"
        )
    clamped_first, clamped_last = max(first, wanted_first), min(last, wanted_last)
    if clamped_first > clamped_last:
        clamped_first, clamped_last = first, last  # nothing would be left
    interval = max(0, min(LONGEST_INTERVAL, round(1.0 / (parameters.period_s * settings.rate_hz)) - 1))
    return ScanRequest(settings.command, clamped_first, clamped_last, settings.cluster, interval), warning


def _step(angle_deg: float, parameters: Parameters) -> float:
    """The inverse of Parameters.bearing_rad."""
    return parameters.front_step + math.radians(angle_deg) / parameters.step_rad
