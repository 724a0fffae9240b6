"""Distances along rays to circles and walls, each ray with its own origin."""

from typing import TypeVar

import numpy as np

from drivers.measurements import FloatArray, IntArray
from drivers.settings.simulated_world import LaserGeometrySettings

Beams = TypeVar("Beams", FloatArray, IntArray)


def beams_about_mount(laser: LaserGeometrySettings) -> tuple[FloatArray, FloatArray]:
    """Bearings (n,) from the mount's heading, rising to the left, and when each is measured after step 0, s.

    A laser that hangs upside down sweeps to the right, so that its last step comes first.
    """
    steps = np.arange(laser.beam_count, dtype=np.float64)
    bearings_rad: FloatArray = laser.first_bearing_rad + laser.beam_spacing_rad * steps
    delays_s: FloatArray = laser.beam_period_s * steps
    return (-bearings_rad[::-1], delays_s[::-1]) if laser.upside_down else (bearings_rad, delays_s)


def as_stepped(laser: LaserGeometrySettings, values: Beams) -> Beams:
    """Values (n,) in the order of `beams_about_mount`, in that of the laser's steps."""
    return values[::-1].copy() if laser.upside_down else values


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


def circles_met(
    origins: FloatArray,
    directions: FloatArray,
    from_m: FloatArray,
    to_m: FloatArray,
    radii_m: FloatArray,
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Entry distances, chords, rays and circles of all pairs that can meet, circles moving from_m to_m (c, 2)."""
    middle, count = origins.shape[0] // 2, origins.shape[0]
    # Everything the laser and the circle do within the sweep counts as more width of the circle.
    offset = 0.5 * (from_m + to_m) - origins[middle]
    travel = np.hypot(*(origins[-1] - origins[0])) + np.hypot(*(to_m - from_m).T)
    distance = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-6)
    bearing = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    even = np.linspace(bearing[0], bearing[-1], count)
    half_width = np.arcsin(np.minimum((radii_m + travel) / distance, 1.0))
    half_width[radii_m + travel >= distance] = np.pi
    half_width = half_width + np.abs(even - bearing).max() + 0.01
    rays, circles = pairs_in_view(even, np.arctan2(offset[:, 1], offset[:, 0]), half_width)
    part = (rays / max(count - 1, 1))[:, None]
    centres_m = from_m[circles] + part * (to_m[circles] - from_m[circles])
    entry, chord = circle_hits(origins[rays], directions[rays], centres_m, radii_m[circles])
    return entry, chord, rays, circles


def beams(
    body_m: FloatArray,
    heading_rad: FloatArray,
    body_from_laser: tuple[float, float, float],
    bearings_rad: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Origins (n, 2) and unit vectors (n, 2) in the map of beams at bearings (n,), each from its own pose of the body.

    body_m (n, 2) and heading_rad (n,) in the map.
    """
    mount_x, mount_y, mount_heading = body_from_laser
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    lever = np.stack((cosine * mount_x - sine * mount_y, sine * mount_x + cosine * mount_y), axis=-1)
    bearing: FloatArray = heading_rad + mount_heading + bearings_rad
    return body_m + lever, np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)


def segments_met(
    origins: FloatArray, directions: FloatArray, starts_m: FloatArray, ends_m: FloatArray, reach_m: float
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Distances, angles of incidence (0: at right angles, rad), rays and segments of all pairs that can meet.

    origins, directions (n, 2) of one sweep; segments from (s, 2) to (s, 2), those beyond reach_m left out.
    """
    middle = origins[len(origins) // 2]
    span = ends_m - starts_m
    offset = starts_m - middle
    share = np.clip(-(offset * span).sum(axis=1) / np.maximum((span**2).sum(axis=1), 1e-12), 0.0, 1.0)
    travel = float(np.hypot(*(origins[-1] - origins[0])))
    near = np.flatnonzero(np.hypot(*(offset + share[:, None] * span).T) < reach_m + travel)
    first, second = offset[near], ends_m[near] - middle
    begin = np.arctan2(first[:, 1], first[:, 0])
    turn = np.remainder(np.arctan2(second[:, 1], second[:, 0]) - begin + np.pi, 2.0 * np.pi) - np.pi
    ends_away = np.minimum(np.hypot(*first.T), np.hypot(*second.T))
    bearing = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    even = np.linspace(bearing[0], bearing[-1], len(bearing))
    moved = np.arcsin(np.minimum(travel / np.maximum(ends_away, 1e-6), 1.0)) + np.abs(even - bearing).max() + 0.01
    rays, which = pairs_in_view(even, begin + 0.5 * turn, np.minimum(0.5 * np.abs(turn) + moved, np.pi))
    segments = near[which]
    span, offset = span[segments], starts_m[segments] - origins[rays]
    ray = directions[rays]
    cross = ray[:, 0] * span[:, 1] - ray[:, 1] * span[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (offset[:, 0] * span[:, 1] - offset[:, 1] * span[:, 0]) / cross
        along = (offset[:, 0] * ray[:, 1] - offset[:, 1] * ray[:, 0]) / cross
    distance[~((distance > 0.0) & (along >= 0.0) & (along <= 1.0))] = np.inf
    incidence = np.arccos(np.minimum(np.abs(cross) / np.maximum(np.hypot(*span.T), 1e-12), 1.0))
    return distance, incidence, rays, segments
