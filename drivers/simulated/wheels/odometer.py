"""What an encoder counts of the true motion of its wheel: slip, a radius that is not the nominal one, whole counts."""

import math

import numpy as np

from drivers.settings.simulated_wheels import SimulatedWheelSettings


class WheelOdometer:
    """Unwrapped count of one wheel, from the distance that it really rolled."""

    def __init__(self, settings: SimulatedWheelSettings, radius_factor: float, rng: np.random.Generator) -> None:
        self._counts_per_metre = settings.counts_per_rev / (2.0 * math.pi * settings.wheel_radius_m * radius_factor)
        self._slip = settings.slip_std_per_m
        self._rng = rng
        self._travel_m = 0.0
        self._turned_m = 0.0

    @property
    def exact_count(self) -> float:
        """Counts since the start at the last call of `count`, with their fraction."""
        return self._turned_m * self._counts_per_metre

    def count(self, travel_m: float, slip: float = 0.0) -> int:
        """Counts since the start. travel_m: true distance so far, forward positive.

        slip: share by which the wheel turns farther than it moves the rover, as on wet ground.

        Slip is white per way: its variance grows by slip_std_per_m**2 for each metre, never at rest.
        """
        step_m = travel_m - self._travel_m
        self._travel_m = travel_m
        if step_m != 0.0:
            scatter_m = self._slip * math.sqrt(abs(step_m)) * float(self._rng.standard_normal())
            self._turned_m += (1.0 + slip) * step_m + scatter_m
        return math.floor(self.exact_count)
