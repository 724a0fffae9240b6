"""Runs of neighbouring beams on one surface, and the narrow ones among them: trunks and posts."""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import cosine_sine, logarithm
from slam.compiled import kernel
from slam.front_end.deskew import Beams
from slam.settings.front_end import FrontEndSettings

GAP_M = 0.1  # neighbouring returns farther apart are of two things, m, plus GAP_BEAMS
GAP_BEAMS = 3.0  # times the beams' own distance at that range; 3 follows a wall up to 70 deg of incidence
BRIDGE_BEAMS = 1  # so many empty beams do not end a segment, or as many as chance drops in a row:
BRIDGE_CHANCE, HOLE_CHANCE = 1e-3, 1e-4  # probabilities of a longer run of dropped beams; of a hole
MOST_DROPPED = 12  # in a row: half of all beams, once in four thousand
GUARD_BEAMS = 2  # so many beams beside a segment must not fall on anything near it
HOLE_BEAMS = 8  # so many empty beams in a row may be a hole in a surface, or as many as chance drops
PROMINENCE_M = 0.3  # what is beside a segment is behind it by this, m
THIN_PROMINENCE_M = 0.6  # the same for segments of one or two beams, m: noise has such dips too
ROUGHNESS = 0.12  # RMS distance from a round trunk, in radii, beyond which a segment is none; a flat board has 0.22
SET_BACK = math.pi / 4.0  # mean over a round face of its depth before the centre, in radii


class Holes(NamedTuple):
    """How many empty beams in a row do not end a segment, how many may be a hole in a surface, and how far apart its
    neighbouring returns may be, m per m of range.
    """

    bridge: int
    longest: int
    gap_per_m: float


@kernel
def _runs(
    points_m: FloatArray, ranges_m: FloatArray, gap_m: float, gap_per_m: float, bridge: int, runs: IntArray
) -> int:
    count, last = 0, -1
    for beam in range(ranges_m.shape[0]):
        if math.isnan(ranges_m[beam]):
            continue
        joined = False
        if last >= 0 and beam - last <= bridge + 1:
            step_x, step_y = points_m[beam, 0] - points_m[last, 0], points_m[beam, 1] - points_m[last, 1]
            limit = gap_m + gap_per_m * (beam - last) * min(ranges_m[beam], ranges_m[last])
            joined = step_x * step_x + step_y * step_y <= limit * limit
        if joined:
            runs[count - 1, 1] = beam
        else:
            runs[count, 0] = runs[count, 1] = beam
            count += 1
        last = beam
    return count


@kernel
def _dropped(points_m: FloatArray, ranges_m: FloatArray, gap_m: float, gap_per_m: float) -> float:
    """Share of the beams on surfaces that came back empty: those between two returns close to each other."""
    dropped, returned, last = 0, 0, -1
    for beam in range(ranges_m.shape[0]):
        if math.isnan(ranges_m[beam]):
            continue
        if last >= 0 and beam - last <= MOST_DROPPED + 1:
            step_x, step_y = points_m[beam, 0] - points_m[last, 0], points_m[beam, 1] - points_m[last, 1]
            limit = gap_m + gap_per_m * (beam - last) * min(ranges_m[beam], ranges_m[last])
            if step_x * step_x + step_y * step_y <= limit * limit:
                dropped += beam - last - 1
                returned += 1
        last = beam
    return dropped / max(dropped + returned, 1)


def holes_in(beams: Beams) -> Holes:
    """What is dropped by chance in this scan: on wet, dark and glass surfaces, in rain."""
    gap_per_m = GAP_BEAMS * beams.spacing_rad
    share = _dropped(beams.points_m, beams.ranges_m, GAP_M, gap_per_m)
    if share <= 0.0:
        return Holes(BRIDGE_BEAMS, HOLE_BEAMS, gap_per_m)
    bridge, longest = (math.ceil(logarithm(chance) / logarithm(share)) for chance in (BRIDGE_CHANCE, HOLE_CHANCE))
    return Holes(
        min(max(BRIDGE_BEAMS, bridge - 1), MOST_DROPPED), min(max(HOLE_BEAMS, longest), 2 * MOST_DROPPED), gap_per_m
    )


def runs_of_beams(beams: Beams, holes: Holes) -> IntArray:
    """(s, 2) first and last beam of every run whose neighbours lie close to each other, in order of the beams."""
    runs = np.empty((len(beams), 2), dtype=np.int64)
    count = _runs(beams.points_m, beams.ranges_m, GAP_M, holes.gap_per_m, holes.bridge, runs)
    return runs[:count]


@kernel
def clear_beside(ranges_m: FloatArray, beam: int, step: int, holes: Holes, behind_m: float) -> bool:
    """True if the first return beside `beam` lies behind it by more than behind_m; False at the end of the sweep.

    Something nearer hides where the surface really ends. Where GUARD_BEAMS came back empty, and more than chance drops,
    a return as far away within the longest hole says that the surface goes on behind it.
    """
    near = max(GUARD_BEAMS, holes.bridge)
    for offset in range(1, max(near, holes.longest) + 1):
        other = beam + step * offset
        if other < 0 or other >= ranges_m.shape[0]:
            return offset > 1
        if not math.isnan(ranges_m[other]):
            if offset <= GUARD_BEAMS:
                return bool(ranges_m[other] > ranges_m[beam] + behind_m)
            off_m = ranges_m[other] - ranges_m[beam]
            goes_on_m = PROMINENCE_M + holes.gap_per_m * offset * min(ranges_m[other], ranges_m[beam])
            return bool(off_m > goes_on_m or (offset > near and off_m < -goes_on_m))
    return True


@kernel
def _least_roughness(
    ranges_m: FloatArray, bearings_rad: FloatArray, first: int, last: int, mean_m: float, spacing_rad: float
) -> float:
    """RMS distance, m, of these beams from the best of the round faces that they can come from.

    Each edge lies between the last beam on the face and the next one; three places of it tell enough apart. It matters
    because a beam that grazes the edge returns from sqrt(radius s) farther behind than one half a spacing s inside.
    """
    least = np.inf
    for left in range(3):
        for right in range(3):
            start = bearings_rad[first] - 0.5 * left * spacing_rad
            end = bearings_rad[last] + 0.5 * right * spacing_rad
            half_sine = cosine_sine(min(0.5 * (end - start), 0.5 * math.pi))[1]
            if SET_BACK * half_sine > 0.8:
                continue
            distance = mean_m / (1.0 - SET_BACK * half_sine)
            radius, bearing = distance * half_sine, 0.5 * (start + end)
            hits, rough = 0, 0.0
            for beam in range(first, last + 1):
                if not math.isnan(ranges_m[beam]):
                    turned_cosine, turned_sine = cosine_sine(bearings_rad[beam] - bearing)
                    across = distance * turned_sine
                    depth = math.sqrt(max(radius * radius - across * across, 0.0))
                    off = ranges_m[beam] - distance * turned_cosine + depth
                    hits += 1
                    rough += off * off
            least = min(least, rough / hits)
    return math.sqrt(least)


@kernel
def _trunks(
    ranges_m: FloatArray,
    bearings_rad: FloatArray,
    runs: IntArray,
    spacing_rad: float,
    sigma_m: float,
    width_max_m: float,
    holes: Holes,
    trunks: FloatArray,
) -> int:
    count = 0
    for run in range(runs.shape[0]):
        first, last = runs[run, 0], runs[run, 1]
        if last - first > 2 and (bearings_rad[last] - bearings_rad[first]) * ranges_m[first] > 2.0 * width_max_m:
            continue
        nearest = np.inf
        for beam in range(first, last + 1):
            if ranges_m[beam] < nearest:
                nearest = ranges_m[beam]
        # A beam that fell half beside the edge measures something behind it: not part of a round face.
        face = nearest + 0.5 * nearest * (bearings_rad[last] - bearings_rad[first] + spacing_rad) + 3.0 * sigma_m
        if first < last and not ranges_m[first] <= face:
            first += 1
        if last > first and not ranges_m[last] <= face:
            last -= 1
        if not (ranges_m[first] <= face and ranges_m[last] <= face):
            continue
        hits, total = 0, 0.0
        for beam in range(first, last + 1):
            if not math.isnan(ranges_m[beam]):
                hits += 1
                total += ranges_m[beam]
        mean = total / hits
        half_angle = 0.5 * (bearings_rad[last] - bearings_rad[first] + spacing_rad)
        half_sine = cosine_sine(min(half_angle, 0.5 * math.pi))[1]
        if SET_BACK * half_sine > 0.8:
            continue
        distance = mean / (1.0 - SET_BACK * half_sine)
        radius = distance * half_sine
        if 2.0 * radius > width_max_m:
            continue
        behind = THIN_PROMINENCE_M if hits <= 2 else PROMINENCE_M
        if not (
            clear_beside(ranges_m, runs[run, 0], -1, holes, ranges_m[first] - ranges_m[runs[run, 0]] + behind)
            and clear_beside(ranges_m, runs[run, 1], 1, holes, ranges_m[last] - ranges_m[runs[run, 1]] + behind)
        ):
            continue
        bearing = 0.5 * (bearings_rad[first] + bearings_rad[last])
        rough_m = _least_roughness(ranges_m, bearings_rad, first, last, mean, spacing_rad) if hits >= 4 else 0.0
        if rough_m > ROUGHNESS * radius + sigma_m:
            continue
        trunks[count, 0], trunks[count, 1], trunks[count, 2] = distance, bearing, radius
        trunks[count, 3], trunks[count, 4], trunks[count, 5] = hits, first, last
        count += 1
    return count


def trunks(beams: Beams, runs: IntArray, settings: FrontEndSettings, holes: Holes) -> FloatArray:
    """(t, 6) narrow runs with background behind both edges.

    Columns: range m and bearing rad of the centre, radius m, number of returns, first and last beam.
    """
    found = np.empty((runs.shape[0], 6))
    count = _trunks(
        beams.ranges_m,
        beams.bearings_rad,
        runs,
        beams.spacing_rad,
        settings.sigma_range_m,
        settings.width_max_m,
        holes,
        found,
    )
    return found[:count]


def trunk_variances(found: FloatArray, spacing_rad: float, settings: FrontEndSettings) -> FloatArray:
    """(t, 2) variances of range m^2 and bearing rad^2 of centres, from the geometry of their beams.

    Each edge lies anywhere within one beam spacing: the middle of both has variance 1/24 of its square, their distance
    1/6. The centre is set back by pi/4 of half that distance; the mean depth of a round face varies by 0.22 radii from
    beam to beam.
    """
    distance, radius, hits = found[:, 0], found[:, 2], found[:, 3]
    set_back = SET_BACK * 0.5 * distance * spacing_rad
    range_variance = (
        squared(settings.sigma_range_m) / hits + np.square(set_back) / 6.0 + np.square(0.22 * radius / hits)
    )
    bearing_variance = np.full(len(found), squared(spacing_rad) / 24.0)
    return np.stack(
        (
            range_variance + squared(settings.sigma_range_floor_m),
            bearing_variance + squared(settings.sigma_bearing_floor_rad),
        ),
        axis=-1,
    )
