"""Distances along rays to circles and walls, each ray with its own origin."""

import numpy as np

from drivers.measurements import FloatArray, IntArray


def pairs_in_view(
    bearings_rad: FloatArray, centre_bearings_rad: FloatArray, half_widths_rad: FloatArray
) -> tuple[IntArray, IntArray]:
    """(p,) rays and (p,) circles that can meet: the ray's bearing is within the half width of the circle's.

    bearings_rad (n,) equally spaced and increasing, of any turn; the others (c,).
    """
    spacing = (bearings_rad[-1] - bearings_rad[0]) / (bearings_rad.size - 1)
    turns = 2.0 * np.pi * np.array((-1.0, 0.0, 1.0))[:, None]
    low = np.ceil((centre_bearings_rad - half_widths_rad + turns - bearings_rad[0]) / spacing)
    high = np.floor((centre_bearings_rad + half_widths_rad + turns - bearings_rad[0]) / spacing)
    first = np.clip(low, 0, bearings_rad.size).astype(np.int64).ravel()
    count = np.maximum(np.clip(high + 1, 0, bearings_rad.size).astype(np.int64).ravel() - first, 0)
    circle = np.repeat(np.tile(np.arange(centre_bearings_rad.size), 3), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.repeat(first, count) + within, circle


def circle_hits(
    origins_m: FloatArray, directions: FloatArray, centres_m: FloatArray, radii_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distances (p,) at which each ray enters its circle (inf: misses it or starts within), and the chords (p,).

    origins_m, directions (unit vectors) and centres_m are (p, 2), radii_m (p,).
    """
    offset = centres_m - origins_m
    along = offset[:, 0] * directions[:, 0] + offset[:, 1] * directions[:, 1]
    across = offset[:, 1] * directions[:, 0] - offset[:, 0] * directions[:, 1]
    square = radii_m**2 - across**2
    half_chord = np.sqrt(np.maximum(square, 0.0))
    entry = along - half_chord
    entry[(square <= 0.0) | (entry <= 0.0)] = np.inf
    return entry, 2.0 * half_chord


def wall_hits(origins_m: FloatArray, directions: FloatArray, starts_m: FloatArray, ends_m: FloatArray) -> FloatArray:
    """Distances (n, w) at which ray n meets the wall from start to end (w, 2); inf where it does not."""
    span = ends_m - starts_m
    offset = starts_m - origins_m[:, None, :]
    cross = directions[:, None, 0] * span[:, 1] - directions[:, None, 1] * span[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[..., 0] * span[:, 1] - offset[..., 1] * span[:, 0]) / cross
        along = (offset[..., 0] * directions[:, None, 1] - offset[..., 1] * directions[:, None, 0]) / cross
    distance[~((distance > 0.0) & (along >= 0.0) & (along <= 1.0))] = np.inf
    return distance
