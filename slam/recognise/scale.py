"""How exact landmarks are and how far apart they stand where this rover drives, from what the settings say of it."""

import math
from dataclasses import dataclass

from slam.settings.slam import SlamSettings

LEAST_SIGMA_M = 0.12
FLOOR_SHARE = 0.5  # the noise of the settings stands for much else
NOISE_TIMES = 1.5
SHORTEST_PAIR_M, SHORTEST_SHARE = 4.0, 0.25
WIDEST_LOCAL_M, WIDEST_LOCAL_TIMES = 0.5, 3.0
GATE_SIGMAS = 2.5
SAME_SHARE = 0.4
LEAST_STEP_M, STEP_TIMES = 0.5, 5.0


@dataclass(frozen=True, slots=True)
class Scale:
    """sigma_m: how far two parts of a map some 30 m apart are off each other: two to three times the scatter of one
    landmark seen twice, since the map itself is bent a little.

    shortest_pair_m: a shorter pair of landmarks says nothing of the heading.
    """

    sigma_m: float
    shortest_pair_m: float = SHORTEST_PAIR_M

    @classmethod
    def of(cls, settings: SlamSettings) -> "Scale":
        """What the settings of a sensor and a place say."""
        front_end = settings.front_end
        noise_m = max(FLOOR_SHARE * front_end.sigma_range_floor_m, NOISE_TIMES * front_end.sigma_range_m)
        shortest_m = min(SHORTEST_PAIR_M, SHORTEST_SHARE * settings.view.range_max_m)
        return cls(max(noise_m, LEAST_SIGMA_M), shortest_m)

    @property
    def widest_local_m(self) -> float:
        """Standard deviation, seen from the rover, of the least exact local landmark that is used."""
        return max(WIDEST_LOCAL_M, WIDEST_LOCAL_TIMES * self.sigma_m)

    @property
    def widest_gate_m(self) -> float:
        """How far a landmark of the map is looked for at most."""
        return GATE_SIGMAS * math.hypot(self.sigma_m, self.widest_local_m)

    @property
    def same_sigma_m(self) -> float:
        """Scatter of one landmark seen twice."""
        return SAME_SHARE * self.sigma_m
