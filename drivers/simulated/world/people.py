"""People in the park: where their legs or bodies are, as a function of time."""

import numpy as np

from drivers.measurements import FloatArray
from drivers.simulated.world.course import Course

BODY_RADIUS_M = 0.25
LEG_RADIUS_M = 0.07
HALF_STRIDE_M = 0.3
STEP_HZ = 0.9
KEEP_CLEAR_M = 0.95


class People:
    """Every third walks along the course, every third crosses the park, every third stands and then leaves.

    Every second is seen as two swinging legs, the others as one body. They step around the rover.
    """

    def __init__(
        self, count: int, course: Course, low_m: FloatArray, high_m: FloatArray, rng: np.random.Generator
    ) -> None:
        """Draw the walks; they turn round at the borders of the park, from low_m (2,) to high_m (2,)."""
        self._course = course
        self._number = np.arange(count)
        self._phase = rng.uniform(0.0, 1.0, count)
        self._speed_mps = rng.uniform(0.7, 1.4, count)
        self._side_m = rng.choice((-1.0, 1.0), count) * rng.uniform(0.9, 1.6, count)
        self._stand_s = rng.uniform(8.0, 25.0, count)
        around = course.points_m(rng.uniform(0.0, course.length_m, count))
        bearing = rng.uniform(-np.pi, np.pi, count)
        toward = np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
        reach = rng.uniform(4.0, 9.0, count)[:, None]
        self._from_m = np.clip(around - reach * toward, low_m, high_m)
        self._to_m = np.clip(around + reach * toward, low_m, high_m)
        self._legged = self._number % 2 == 0
        left = np.where(self._legged, LEG_RADIUS_M, BODY_RADIUS_M)
        self.radii_m = np.concatenate((left, np.full(count, LEG_RADIUS_M)))

    def circles_m(self, time_s: FloatArray, rover_m: FloatArray) -> FloatArray:
        """Centres (n, 2 people, 2) at times (n,) with the rover at (n, 2); a body is drawn twice.

        The first half are left legs or bodies, the second half right legs.
        """
        centre, ahead, walked = self._walks(time_s[:, None])
        from_rover = centre - rover_m[:, None, :]
        distance = np.maximum(np.hypot(from_rover[..., 0], from_rover[..., 1]), 1e-6)
        centre = centre + from_rover * (np.maximum(KEEP_CLEAR_M - distance, 0.0) / distance)[..., None]
        swing = HALF_STRIDE_M * np.sin(2.0 * np.pi * STEP_HZ / 1.1 * walked) * self._legged
        aside = _left_of(ahead) * (0.1 * self._legged)[:, None]
        leg = ahead * swing[..., None] + aside
        return np.concatenate((centre + leg, centre - leg), axis=1)

    def _walks(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Centres (n, p, 2), unit vectors ahead (n, p, 2), metres walked (n, p)."""
        span = self._to_m - self._from_m
        length = np.maximum(np.hypot(span[:, 0], span[:, 1]), 1e-6)
        leaves = self._number % 3 == 2
        walked = self._speed_mps * np.where(leaves, np.maximum(time_s - self._stand_s, 0.0), time_s)
        cycle = np.mod(walked / length + self._phase, 2.0)
        there = np.where(cycle < 1.0, cycle, 2.0 - cycle)
        unit = span / length[:, None]
        ahead = np.where(cycle[..., None] < 1.0, unit, -unit)
        centre = self._from_m + there[..., None] * span
        along = self._number % 3 == 0
        if np.any(along):
            arc = self._phase[along] * self._course.length_m + np.sign(self._side_m[along]) * walked[:, along]
            ahead[:, along] = self._ahead_at(arc)
            centre[:, along] = self._course.points_m(arc) + _left_of(ahead[:, along]) * self._side_m[along][:, None]
        return centre, ahead, walked

    def _ahead_at(self, arc_m: FloatArray) -> FloatArray:
        heading = self._course.heading_rad(arc_m)
        return np.stack((np.cos(heading), np.sin(heading)), axis=-1)


class CorridorPeople(People):
    """All walk along the course, to and fro between two places, and stand for a while before they turn round."""

    def __init__(self, count: int, course: Course, beside_m: tuple[float, float], rng: np.random.Generator) -> None:
        """beside_m: least and greatest distance from the course, which must leave the walls alone."""
        low_m, high_m = np.full(2, -np.inf), np.full(2, np.inf)
        super().__init__(count, course, low_m, high_m, rng)
        self._side_m = rng.choice((-1.0, 1.0), count) * rng.uniform(*beside_m, count)
        self._begin_m = rng.uniform(0.0, course.length_m, count)
        self._reach_m = rng.uniform(10.0, 40.0, count)

    def _walks(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        one_way_s = self._reach_m / self._speed_mps
        turn_s = one_way_s + self._stand_s
        turns, into_s = np.divmod(time_s + 2.0 * self._phase * turn_s, turn_s)
        there = self._speed_mps * np.minimum(into_s, one_way_s)
        back = np.mod(turns, 2.0) == 1.0
        ahead = self._ahead_at(arc := self._begin_m + np.where(back, self._reach_m - there, there))
        centre = self._course.points_m(arc) + _left_of(ahead) * self._side_m[:, None]
        return centre, np.where(back[..., None], -ahead, ahead), there


def _left_of(ahead: FloatArray) -> FloatArray:
    return np.stack((-ahead[..., 1], ahead[..., 0]), axis=-1)
