"""What a calibration found: values with 95 % intervals, and what it could not determine and why."""

import math
from dataclasses import dataclass, field
from typing import Any

from runtime.calibrate.richness import MotionCoverage
from runtime.calibrate.scans.orientation import AS_BELIEVED, Orientation
from runtime.calibrate.single_causes import Fit

SCALES = ("distance_scale", "turn_scale", "speed_scale")
NO_SETTING = "no key sets this: correct it in the base, which computes it"


@dataclass(frozen=True, slots=True)
class Quantity:
    """One calibrated value; low to high holds the truth 95 times in 100. refused: why it is not reported, "" if it is.

    Where it is refused, value, low and high are what the search ended with and must not be used.
    """

    name: str
    value: float
    low: float
    high: float
    refused: str = ""

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Calibration:
    """The whole result. missing: sentences that say what to drive or check; rich: nothing is missing.

    steps: pieces of way on which wheels and laser agree; left_out: on which they do not; unmatched: seen too little of.
    fit: all parameters together, None where nothing of it can be believed. contradicts_start: that is so because wheels
    and laser disagree, or the result is too far from the start to be wear. orientation: of the laser, against what
    was believed.
    """

    drives: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    measures: tuple[MotionCoverage, ...]
    missing: tuple[str, ...]
    steps: int
    left_out: int
    unmatched: int
    fit: Fit | None = field(default=None, compare=False)
    contradicts_start: bool = False
    orientation: Orientation = AS_BELIEVED

    @property
    def rich(self) -> bool:
        """True if everything could be determined."""
        return not self.missing and not any(quantity.refused for quantity in self.quantities)

    def quantity(self, name: str) -> Quantity:
        """By name. Raises KeyError."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def reported(self, name: str) -> Quantity | None:
        """The same, None where it is refused or was not sought."""
        found = [quantity for quantity in self.quantities if quantity.name == name and not quantity.refused]
        return found[0] if found else None

    def as_json(self) -> dict[str, Any]:
        """For --json: refused values are null."""
        return {
            "drives": list(self.drives),
            "rich": self.rich,
            "missing": list(self.missing),
            "quantities": {quantity.name: _quantity_json(quantity) for quantity in self.quantities},
            "measures": {item.name: _measure_json(item) for item in self.measures},
            "steps": self.steps,
            "left_out": self.left_out,
            "unmatched": self.unmatched,
            "mirrored": self.orientation.mirrored,
            "turned_rad": self.orientation.turned_rad,
        }


def calibration_lines(result: Calibration) -> list[str]:
    """For people, one line a value."""
    lines = [
        f"{', '.join(result.drives)}: {result.steps} steps used, {result.left_out} left out, "
        f"{result.unmatched} without a match"
    ]
    for quantity in result.quantities:
        if quantity.refused:
            why = "see below" if quantity.refused in result.missing else quantity.refused
            lines.append(f"{quantity.name:24s} not determined: {why}")
        else:
            aside = f"  ({NO_SETTING})" if quantity.name in SCALES else ""
            span = f"95 %: {quantity.low:.5f} to {quantity.high:.5f}"
            lines.append(f"{quantity.name:24s} {quantity.value:10.5f}  {span}{aside}")
    if result.orientation.mirrored:
        lines.append(
            "the laser hangs the other way up than configured: left and right are swapped in its scans (or "
            "the left and right wheels are swapped: then the map is mirrored)"
        )
    if turned_rad := result.orientation.turned_rad:
        lines.append(f"the laser is turned by {math.degrees(turned_rad):+.0f} deg from its configured yaw")
    lines += [f"missing: {sentence}" for sentence in result.missing]
    return lines


def _measure_json(item: MotionCoverage) -> dict[str, Any]:
    return {"have": item.have, "want": item.want, "unit": item.unit}


def _quantity_json(quantity: Quantity) -> dict[str, Any]:
    if quantity.refused:
        return {"value": None, "low": None, "high": None, "refused": quantity.refused}
    return {"value": quantity.value, "low": quantity.low, "high": quantity.high, "refused": None}
