"""Dead reckoning of a whole drive at once: distance and heading piecewise linear in time, positions by exact arcs."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from slam.pose import composed, inverted, rotated

SMALL_RAD = 1e-4  # below this turn the series is exact to the last bit that matters


@dataclass(frozen=True, slots=True, eq=False)
class DeadReckoning:
    """Poses (n, 3) of the body in the odometry frame at times_s (n,), distances_m (n,) driven until then."""

    times_s: FloatArray
    distances_m: FloatArray
    poses: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Poses (m, 3) at any times: on the arc between two samples, held beyond the ends."""
        index = np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self.times_s) - 2)
        span = self.times_s[index + 1] - self.times_s[index]
        share = np.clip((times_s - self.times_s[index]) / span, 0.0, 1.0)
        distance = share * (self.distances_m[index + 1] - self.distances_m[index])
        turn = share * (self.poses[index + 1, 2] - self.poses[index, 2])
        return moved(self.poses[index], distance, turn)

    def velocity(self, times_s: FloatArray, half_window_s: float) -> FloatArray:
        """Forward m/s and yaw rate rad/s, (m, 2), as means over a window around each time."""
        before, after = times_s - half_window_s, times_s + half_window_s
        distance = np.interp(after, self.times_s, self.distances_m) - np.interp(before, self.times_s, self.distances_m)
        turn = np.interp(after, self.times_s, self.poses[:, 2]) - np.interp(before, self.times_s, self.poses[:, 2])
        return np.stack((distance, turn), axis=-1) / (2.0 * half_window_s)


def dead_reckoning(times_s: FloatArray, distances_m: FloatArray, headings_rad: FloatArray) -> DeadReckoning:
    """Integrate distance and heading (n,) at the samples' times, headings not wrapped, into poses from the origin."""
    steps, turns = np.diff(distances_m), np.diff(headings_rad)
    ahead, left = chord(steps, turns)
    poses = np.zeros((len(times_s), 3))
    np.cumsum(rotated(np.stack((ahead, left), axis=-1), headings_rad[:-1]), axis=0, out=poses[1:, :2])
    poses[:, 2] = headings_rad
    return DeadReckoning(times_s, distances_m, poses)


def chord(distance: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Displacement ahead and to the left of arcs of given length and turn, (n,) each."""
    small = np.abs(turn) < SMALL_RAD
    safe = np.where(small, 1.0, turn)
    along = np.where(small, 1.0 - turn * turn / 6.0, np.sin(safe) / safe)
    across = np.where(small, turn / 2.0, (1.0 - np.cos(safe)) / safe)
    return distance * along, distance * across


def moved(poses: FloatArray, distance: FloatArray, turn: FloatArray) -> FloatArray:
    """Poses (n, 3) after arcs."""
    ahead, left = chord(distance, turn)
    return composed(poses, np.stack((ahead, left, turn), axis=-1))


def seen_by_laser(increments: FloatArray, mount: FloatArray) -> FloatArray:
    """Motion (n, 3) of the body as the laser, mounted at body_from_laser (3,), makes it."""
    mounts = np.broadcast_to(mount, increments.shape)
    return composed(inverted(mounts), composed(increments, mounts))
