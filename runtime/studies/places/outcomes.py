"""What came out of one place driven in one way, and the names of places and ways."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.jobs import Result

OWN, DEFAULTS, AT_REST, SIMULATED = "own file", "defaults", "at rest", "defaults, simulated"
BUILDINGS = {
    "building_4hz": (4.0, 1081),
    "building_10hz": (10.0, 1081),
    "building_360_beams": (10.0, 360),
    "building_181_beams": (10.0, 181),
}
"""The simulated one: scans a second, and beams of the laser."""
DROPPED = "drop_outs"

Key = tuple[str, str]  # place, and the way in which it was driven


@dataclass(slots=True)
class Outcome:
    """One place driven in one way: with everything that was seen (None for a simulated one), and repeated.

    Repeats leave 5 % of the scans of a recording out; those of a simulated place are seeds.
    """

    whole: Result | None = None
    repeats: list[Result] = field(default_factory=list)

    @property
    def results(self) -> list[Result]:
        """All of them."""
        return [*([] if self.whole is None else [self.whole]), *self.repeats]

    def values(self, name: str) -> FloatArray:
        """One figure of all results that have it, (n,)."""
        return np.array([result[name] for result in self.results if name in result], dtype=np.float64)

    def repeated(self, name: str) -> FloatArray:
        """The same of the repeats alone."""
        return np.array([result[name] for result in self.repeats if name in result], dtype=np.float64)


Outcomes = Mapping[Key, Outcome]


def dropped(share: float) -> str:
    """The way in which a place is driven when so many beams give no return."""
    return f"{100 * share:.0f} % dropped"
