"""Doors of a building: some stay shut, some stay open, the others are opened and closed all day."""

import numpy as np

from drivers.measurements import FloatArray

WIDTH_M = 0.9
SWING_S = 1.5
SHUT_SHARE, OPEN_SHARE = 0.35, 0.35
SHUT_S, OPEN_S = (15.0, 90.0), (5.0, 60.0)
OPENING_RAD = (1.2, 1.9)


class Doors:
    """Leaves that turn about their hinges into the rooms: where they are, as a function of time."""

    def __init__(self, hinges_m: FloatArray, closed: FloatArray, inward: FloatArray, rng: np.random.Generator) -> None:
        """hinges_m (d, 2); unit vectors (d, 2) from hinge to latch of a closed door, and into the room."""
        count = len(hinges_m)
        self._hinges_m, self._closed, self._inward = hinges_m, closed, inward
        self._opening_rad = rng.uniform(*OPENING_RAD, count)
        habit = rng.random(count)
        self._fixed = np.where(habit < SHUT_SHARE, 0.0, np.where(habit < SHUT_SHARE + OPEN_SHARE, 1.0, np.nan))
        self._shut_s = rng.uniform(*SHUT_S, count)
        self._open_s = rng.uniform(*OPEN_S, count)
        self._phase = rng.random(count)

    def opened(self, time_s: float) -> FloatArray:
        """How far each is open (d,), 0 shut to 1."""
        cycle_s = self._shut_s + self._open_s + 2.0 * SWING_S
        into_s = np.mod(time_s + self._phase * cycle_s, cycle_s) - self._shut_s
        opening, closing = into_s / SWING_S, (2.0 * SWING_S + self._open_s - into_s) / SWING_S
        moved = np.clip(np.minimum(opening, closing), 0.0, 1.0)
        opened: FloatArray = np.where(np.isnan(self._fixed), moved, self._fixed)
        return opened

    def leaves_m(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Hinges and free edges (d, 2) of the leaves."""
        angle = (self._opening_rad * self.opened(time_s))[:, None]
        return self._hinges_m, self._hinges_m + WIDTH_M * (np.cos(angle) * self._closed + np.sin(angle) * self._inward)
