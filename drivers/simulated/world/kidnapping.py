"""A rover that is lifted and put down elsewhere while its wheels report nothing of it."""

import numpy as np

from drivers.measurements import FloatArray
from drivers.simulated.world.rover_path import RoverPath


class KidnappedPath(RoverPath):
    """Another path up to a moment; from then on the same motion, begun from another pose."""

    def __init__(self, before: RoverPath, at_s: float, moved_m: tuple[float, float], turned_rad: float) -> None:
        """before: the path, which may have a kidnapping of its own. moved_m: by how much the position changes, in the
        map; turned_rad: the heading, counter-clockwise.
        """
        self.course = before.course
        self._before = before
        self._at_s = at_s
        self._moved_m = np.array(moved_m)
        self._turned_rad = turned_rad
        self._pivot_m = before.poses(np.array([at_s]))[0][0]

    def arc_m(self, time_s: FloatArray) -> FloatArray:
        """Distance driven (any shape) at times since the world began."""
        return self._before.arc_m(time_s)

    def wheel_travel_m(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left and right travel, in which nothing is to be seen of it."""
        return self._before.wheel_travel_m(time_s)

    def poses(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 2) in the map and unwrapped headings (n,) of the body."""
        points, headings = self._before.poses(time_s)
        cosine, sine = np.cos(self._turned_rad), np.sin(self._turned_rad)
        x, y = np.moveaxis(points - self._pivot_m, -1, 0)
        swung = np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=-1)
        after = time_s >= self._at_s
        carried = self._pivot_m + self._moved_m + swung
        return np.where(after[..., None], carried, points), np.where(after, headings + self._turned_rad, headings)
