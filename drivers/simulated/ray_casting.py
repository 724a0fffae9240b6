"""Distances along rays to circles and walls, each ray with its own origin."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def circle_hits(
    origins_m: FloatArray, directions: FloatArray, centres_m: FloatArray, radii_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances (n, c) at which ray n enters circle c (inf: misses it or starts within), and chords (n, c).

    origins_m (n, 2) or (1, 2); directions (n, 2) unit vectors; centres_m (c, 2) or, for movers, (n, c, 2).
    """
    offset_x = centres_m[..., 0] - origins_m[:, 0, None]
    offset_y = centres_m[..., 1] - origins_m[:, 1, None]
    cosine, sine = directions[:, 0, None], directions[:, 1, None]
    along = offset_x * cosine + offset_y * sine
    across = offset_y * cosine - offset_x * sine
    square = radii_m**2 - across**2
    half_chord = np.sqrt(np.maximum(square, 0.0))
    entry = along - half_chord
    entry[(square <= 0.0) | (entry <= 0.0)] = np.inf
    return entry, 2.0 * half_chord


def wall_hits(
    origins_m: FloatArray, directions: FloatArray, starts_m: FloatArray, ends_m: FloatArray
) -> FloatArray:
    """Distances (n, w) at which ray n meets the wall from start to end (w, 2); inf where it does not."""
    span = ends_m - starts_m
    offset = starts_m - origins_m[:, None, :]
    cross = directions[:, None, 0] * span[:, 1] - directions[:, None, 1] * span[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[..., 0] * span[:, 1] - offset[..., 1] * span[:, 0]) / cross
        along = (offset[..., 0] * directions[:, None, 1] - offset[..., 1] * directions[:, None, 0]) / cross
    distance[~((distance > 0.0) & (along >= 0.0) & (along <= 1.0))] = np.inf
    return distance
