"""Landmarks scattered over a plane, and what a rover sees of them: some missing, some that are in no map."""

import numpy as np

from drivers.measurements import FloatArray
from slam.pose import Pose2
from slam.recognise.attempt import LocalPoints
from slam.recognise.map_index import MapIndex, index_of
from slam.recognise.scale import Scale

SCALE = Scale(0.15)
NOISE_M = 0.05
DENSITY = 0.012  # 1/m^2, of trees in a park
VIEW_M = 25.0


def scattered(generator: np.random.Generator, count: int) -> FloatArray:
    """(count, 2) at DENSITY."""
    return generator.uniform(0.0, np.sqrt(count / DENSITY), (count, 2))


def mapped(generator: np.random.Generator, things_m: FloatArray) -> MapIndex:
    """A map with an eighth of the things missing and as many that are not there."""
    kept = things_m[generator.random(len(things_m)) < 0.875]
    ghosts = generator.uniform(0.0, things_m.max(), (len(things_m) // 8, 2))
    means = np.vstack((kept, ghosts))
    return index_of(SCALE, np.arange(len(means)), means + NOISE_M * generator.standard_normal(means.shape))


def seen_from(generator: np.random.Generator, pose: Pose2, things_m: FloatArray, clutter: int = 4) -> LocalPoints:
    """Four fifths of what is in view, and points that belong to nothing."""
    points = pose.inverse().transform(things_m)
    points = points[(np.hypot(*points.T) < VIEW_M) & (generator.random(len(points)) < 0.8)]
    points = np.vstack((points, generator.uniform(-VIEW_M, VIEW_M, (clutter, 2))))
    return local_points(points + NOISE_M * generator.standard_normal(points.shape))


def local_points(points_m: FloatArray) -> LocalPoints:
    """Points (n, 2) in the body's frame, all as exact as NOISE_M."""
    count = len(points_m)
    return LocalPoints(np.arange(count), points_m, NOISE_M**2 * np.eye(2 * count), np.full(count, 3.0))


def somewhere(generator: np.random.Generator, things_m: FloatArray) -> Pose2:
    """A pose in the middle of the things, any heading."""
    x, y = generator.uniform(0.3, 0.7, 2) * things_m.max()
    return Pose2(float(x), float(y), float(generator.uniform(-np.pi, np.pi)))
