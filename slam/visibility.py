"""What a scan shows, for compiled code: its features, the sensor's pose, the sight line, a landmark in clear view."""

import math
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike
from slam.angles import wrapped
from slam.compiled import leaf
from slam.observations import FeatureRows, Sighting
from slam.settings.tuning import Tuning


class SightLine(NamedTuple):
    """How far each beam of a scan looked.

    first_bearing_rad, step_rad: where beams point. no_return_m: how far a beam without return looked. ranges_m (N,):
    NaN where nothing came back, 0 where a beam ended before the laser's own range; N = 0 where there is no scan.
    """

    first_bearing_rad: float
    step_rad: float
    no_return_m: float
    ranges_m: FloatArray


NO_SIGHT = SightLine(0.0, 0.0, 0.0, np.zeros(0))
BLIND = SightLine(-math.pi, 0.5 * math.pi, 0.0, np.zeros(5))
"""A scan that looked nowhere: no landmark is missed in it."""


@leaf
def sighting_of(features: FeatureRows, index: int) -> Sighting:
    """One of the features."""
    return Sighting(
        features.ranges_m[index],
        features.bearings_rad[index],
        features.rr[index],
        features.rb[index],
        features.bb[index],
    )


@leaf
def in_clear_view(
    landmark_x: float, landmark_y: float, sensor: tuple[float, float, float], sight: SightLine, tuning: Tuning
) -> bool:
    """True where the sensor would have seen the landmark: well inside its range and angle, and nothing at or before it.

    Without a scan range and angle alone decide. A beam that ends at the landmark's distance is no evidence against it.
    """
    dx, dy = landmark_x - sensor[0], landmark_y - sensor[1]
    square = dx * dx + dy * dy
    if square > tuning.missed_range_m * tuning.missed_range_m or square < 0.01:
        return False
    distance = math.sqrt(square)
    bearing = wrapped(math.atan2(dy, dx) - sensor[2])
    if abs(bearing) > tuning.missed_bearing_rad:
        return False
    beams = sight.ranges_m.size
    if beams <= 0:
        return True
    half_width = math.atan2(tuning.sight_half_width_m, distance) + abs(sight.step_rad)
    first = math.floor((bearing - half_width - sight.first_bearing_rad) / sight.step_rad)
    last = math.ceil((bearing + half_width - sight.first_bearing_rad) / sight.step_rad)
    if first < 0 or last >= beams:
        return False
    for beam in range(first, last + 1):
        measured = sight.no_return_m if math.isnan(sight.ranges_m[beam]) else sight.ranges_m[beam]
        if measured < distance + tuning.sight_margin_m:
            return False
    return True


@leaf
def is_hidden(landmark_x: float, landmark_y: float, sensor: tuple[float, float, float], sight: SightLine) -> bool:
    """True where the beam towards the landmark ends at something before it."""
    if sight.ranges_m.size <= 0:
        return False
    dx, dy = landmark_x - sensor[0], landmark_y - sensor[1]
    beam = round((wrapped(math.atan2(dy, dx) - sensor[2]) - sight.first_bearing_rad) / sight.step_rad)
    if beam < 0 or beam >= sight.ranges_m.size:
        return False
    measured = sight.ranges_m[beam]
    return bool(measured > 0.0 and measured * measured < dx * dx + dy * dy)


@leaf
def sensor_pose(pose: FloatArray, mount: FloatArray) -> tuple[float, float, float]:
    """map_from_laser x m, y m, heading rad."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return (
        pose[0] + cosine * mount[0] - sine * mount[1],
        pose[1] + sine * mount[0] + cosine * mount[1],
        pose[2] + mount[2],
    )


def sight_line(scan: ScanLike, range_min_m: float = 0.0) -> SightLine:
    """How far the beams of a scan looked; NO_SIGHT for sightings, and where the bearings do not increase.

    range_min_m: a nearer return is a cover on the lens or the vehicle itself.
    """
    if not isinstance(scan, Scan) or scan.ranges_m.size < 2:
        return NO_SIGHT
    bearings = scan.bearings_rad
    step = (float(bearings[-1]) - float(bearings[0])) / (bearings.size - 1)
    if not math.isfinite(step) or step <= 0.0:
        return NO_SIGHT
    ranges = scan.ranges_m.astype(np.float64)
    ranges[ranges < range_min_m] = 0.0
    return SightLine(float(bearings[0]), step, float(scan.range_max_m), ranges)
