"""People who walk through a world at feature level."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray

RANDOM_WALK_MPS = 1.2
TURN_RAD_PER_SQRT_S = 0.3  # a stroll that keeps its direction for some ten seconds
START_AHEAD_M = (-10.0, 130.0)  # the robot gains 0.6 m/s on them: within a drive it meets and passes everyone
BESIDE_M = (1.0, 6.0)


@dataclass(frozen=True, slots=True, eq=False)
class Walkers:
    """positions_m (people, steps, 2) in the world frame."""

    positions_m: FloatArray


def random_walker(steps: int, period_s: float, low_m: float, high_m: float, generator: np.random.Generator) -> Walkers:
    """One person who wanders at 1.2 m/s within the square area and turns back at its edge."""
    heading = generator.uniform(-np.pi, np.pi)
    position = generator.uniform(low_m, high_m, 2)
    positions = np.empty((1, steps, 2))
    for step in range(steps):
        positions[0, step] = position
        heading += TURN_RAD_PER_SQRT_S * np.sqrt(period_s) * generator.standard_normal()
        ahead = position + RANDOM_WALK_MPS * period_s * np.array((np.cos(heading), np.sin(heading)))
        if ((ahead < low_m) | (ahead > high_m)).any():
            centre = 0.5 * (low_m + high_m)
            heading = np.arctan2(centre - position[1], centre - position[0])
        else:
            position = ahead
    return Walkers(positions)


def walkers_along(
    path_poses: Callable[[FloatArray], FloatArray],
    people: int,
    speed_mps: float,
    steps: int,
    period_s: float,
    generator: np.random.Generator,
) -> Walkers:
    """People who walk beside the path in its direction, each at its own distance to the left or right."""
    starts = generator.uniform(*START_AHEAD_M, people)
    beside = generator.uniform(*BESIDE_M, people) * generator.choice((-1.0, 1.0), people)
    driven = starts[:, np.newaxis] + speed_mps * period_s * np.arange(steps)
    poses = path_poses(driven.ravel()).reshape(people, steps, 3)
    normals = np.stack((-np.sin(poses[..., 2]), np.cos(poses[..., 2])), axis=-1)
    return Walkers(poses[..., :2] + beside[:, np.newaxis, np.newaxis] * normals)
