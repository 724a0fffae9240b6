"""Where the simulated rover is and how far its wheels have rolled: consistent to rounding error."""

import numpy as np

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import DriveSettings
from drivers.simulated.world.course import Course


class RoverPath:
    """At rest, then a smooth ramp to cruising speed, then lap after lap."""

    def __init__(self, settings: DriveSettings) -> None:
        scale = settings.course_scale
        corners = [(scale * x, scale * y) for x, y in settings.corners_m]
        self.course = Course(corners, scale * settings.corner_m)
        self._settings = settings

    def arc_m(self, time_s: FloatArray) -> FloatArray:
        """Distance driven (any shape) at times since the world began; the ramp's speed is a raised cosine."""
        ramp, speed = self._settings.ramp_s, self._settings.speed_mps
        driving = np.maximum(time_s - self._settings.rest_s, 0.0)
        ramping = np.minimum(driving, ramp)
        eased = 0.5 * (ramping - ramp / np.pi * np.sin(np.pi * ramping / ramp))
        distance: FloatArray = speed * (eased + driving - ramping)
        return distance

    def poses(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 2) in the map and unwrapped headings (n,) of the body."""
        arc = self.arc_m(time_s)
        return self.course.points_m(arc), self.course.heading_rad(arc)

    def wheel_travel_m(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left and right travel: on any curve a wheel rolls the arc -+ half a tread times the turn."""
        arc = self.arc_m(time_s)
        offset = 0.5 * self._settings.tread_m * self.course.heading_rad(arc)
        return arc - offset, arc + offset
