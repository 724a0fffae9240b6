"""What stands in each kind of place that is drawn round a course: an orchard, a corridor, or nothing."""

import numpy as np

from drivers.measurements import FloatArray
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.course import Course
from drivers.simulated.world.places.park import Park, plant

ROWS_M, TREES_M = 3.5, 2.0  # from row to row, and from tree to tree in a row
TRUNK_M = (0.06, 0.14)
ROUGH_M = 0.15  # by which a tree stands beside its place
CORRIDOR_HALF_M = 1.3
NICHE_M, NICHE_EVERY_M = 0.4, 4.0  # depth of a door's niche, and from one to the next
CELL_M = 0.5  # of a wall that follows the course


def planted(settings: WorldSettings, course: Course, rng: np.random.Generator) -> Park:
    """What stands in the place that the settings name, clear of the course."""
    match settings.place:
        case "orchard":
            return _orchard(settings, course, rng)
        case "corridor":
            return _corridor(course)
        case "empty":
            return _standing(np.empty((0, 2)), np.empty(0))
        case _:
            return plant(settings, course, rng)


def _standing(trunks_m: FloatArray, radii_m: FloatArray, *walls: tuple[FloatArray, FloatArray]) -> Park:
    starts, ends = (np.vstack([each[k] for each in walls] or [np.empty((0, 2))]) for k in (0, 1))
    return Park(trunks_m, radii_m, 0, np.empty((0, 2)), np.empty(0), starts, ends)


def _orchard(settings: WorldSettings, course: Course, rng: np.random.Generator) -> Park:
    """Rows of trunks, all alike; those in the way of the course were never planted."""
    path = course.points_m(np.arange(0.0, course.length_m, 0.1))
    low, high = path.min(axis=0) - settings.margin_m, path.max(axis=0) + settings.margin_m
    x, y = np.meshgrid(np.arange(low[0], high[0], TREES_M), np.arange(low[1], high[1], ROWS_M))
    trees = np.stack((x.ravel(), y.ravel()), axis=-1) + rng.uniform(-ROUGH_M, ROUGH_M, (x.size, 2))
    radii = rng.uniform(*TRUNK_M, x.size)
    clear = np.hypot(*(trees[:, None] - path).transpose(2, 0, 1)).min(axis=1) > settings.clearance_m + radii
    return _standing(trees[clear], radii[clear])


def _corridor(course: Course) -> Park:
    """Walls on both sides of the course with niches of doors; what would reach into its inside bends is left out."""
    arc = np.arange(0.0, course.length_m + CELL_M, CELL_M)
    path, heading = course.points_m(arc), course.heading_rad(arc)
    left = np.stack((-np.sin(heading), np.cos(heading)), axis=-1)
    in_niche = (arc % NICHE_EVERY_M) < 2 * CELL_M
    walls = []
    for side in (1.0, -1.0):
        away = CORRIDOR_HALF_M + NICHE_M * in_niche
        corners = path + side * away[:, None] * left
        middle = 0.5 * (corners[:-1] + corners[1:])
        clear = np.hypot(*(middle[:, None] - path).transpose(2, 0, 1)).min(axis=1) > 0.8 * CORRIDOR_HALF_M
        walls.append((corners[:-1][clear], corners[1:][clear]))
    return _standing(np.empty((0, 2)), np.empty(0), *walls)
