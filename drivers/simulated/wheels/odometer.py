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

    def count(self, travel_m: float) -> int:
        """Counts since the start. travel_m: true distance so far, forward positive.

        Slip is white per way: its variance grows by slip_std_per_m**2 for each metre, never at rest.
        """
        step_m = travel_m - self._travel_m
        self._travel_m = travel_m
        if step_m != 0.0:
            self._turned_m += step_m + self._slip * math.sqrt(abs(step_m)) * float(self._rng.standard_normal())
        return math.floor(self._turned_m * self._counts_per_metre)
