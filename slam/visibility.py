"""What a scan shows, for compiled code: its features, the sensor's pose, the sight line, a landmark in clear view."""

import math
import struct
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike
from slam.angles import beams_after_first, sees_all_round
from slam.arithmetic.functions import arctangent, cosine_sine, logarithm
from slam.compiled import leaf
from slam.observations import FeatureRows, Sighting
from slam.settings.tuning import Tuning

MISSED_SPACING_M = 0.25  # what is thinner than a trunk falls between beams that are farther apart
SIGHTING_STEP_RAD = math.radians(2.0)  # between the rays that stand for its view
SIGHTING_SHARE = 0.9  # of the farthest sighting: what stands so near is in reach
SIGHTING_EDGE_RAD = math.radians(5.0)  # inside the outermost sighting
FIRST_LOOKS, FIRST_FINDS = 40.0, 30.0  # what is presumed of a sensor that reports things
MOST_LOOKS = 500.0  # its memory
OPEN_SHARE = 0.1  # of the beams without return: on what is dark or shines 5 % are lost, and more only in the open
SLOWEST_GAIN = 0.02  # of that share: its memory is 50 scans
CHANCE = 0.1  # that a landmark seems to be found where none stands


class SightLine(NamedTuple):
    """How far each beam of a scan looked.

    first_bearing_rad, step_rad: where beams point. no_return_m: how far a beam without return looked. ranges_m (N,):
    NaN where nothing came back, 0 where a beam ended before the laser's own range; N = 0 where there is no scan.
    clear_m: nothing farther away is missed. certainty: of a miss, 1 where beams pass by; share of its log-odds.
    """

    first_bearing_rad: float
    step_rad: float
    no_return_m: float
    ranges_m: FloatArray
    clear_m: float = math.inf
    certainty: float = 1.0


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

    Without a scan the range alone decides. A beam that ends at the landmark's distance is no evidence against it.
    """
    dx, dy = landmark_x - sensor[0], landmark_y - sensor[1]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > min(tuning.range_max_m, sight.clear_m) or distance < 0.1:
        return False
    beams = sight.ranges_m.size
    if beams <= 0:
        return True
    bearing = arctangent(dy, dx) - sensor[2]
    middle = beams_after_first(bearing, sight.first_bearing_rad, sight.step_rad, beams)
    half_width = arctangent(tuning.sight_half_width_m, distance) / sight.step_rad + 1.0
    first, last = math.floor(middle - half_width), math.ceil(middle + half_width)
    if not sees_all_round(sight.step_rad, beams) and (first < 0 or last >= beams):
        return False
    beyond_m, empty = distance + tuning.sight_margin_m, 0
    for turned in range(first, last + 1):
        beam = turned % beams
        if math.isnan(sight.ranges_m[beam]):
            empty += 1
        elif sight.ranges_m[beam] < beyond_m:
            return False
    return sight.no_return_m >= beyond_m or 2 * empty <= last + 1 - first


@leaf
def is_in_sight(
    landmark_x: float, landmark_y: float, sensor: tuple[float, float, float], sight: SightLine, tuning: Tuning
) -> bool:
    """True where the landmark is in range and among the beams, and the one towards it does not end before it."""
    dx, dy = landmark_x - sensor[0], landmark_y - sensor[1]
    square, reach_m = dx * dx + dy * dy, min(tuning.range_max_m, sight.clear_m)
    if square > reach_m * reach_m:
        return False
    beams = sight.ranges_m.size
    if beams <= 0:
        return True
    bearing = arctangent(dy, dx) - sensor[2]
    beam = round(beams_after_first(bearing, sight.first_bearing_rad, sight.step_rad, beams))
    if beam < 0 or beam >= beams:
        return False
    measured = sight.ranges_m[beam]
    return not (measured > 0.0 and measured * measured < square)


@leaf
def sensor_pose(pose: FloatArray, mount: FloatArray) -> tuple[float, float, float]:
    """map_from_laser x m, y m, heading rad."""
    cosine, sine = cosine_sine(pose[2])
    return (
        pose[0] + cosine * mount[0] - sine * mount[1],
        pose[1] + sine * mount[0] + cosine * mount[1],
        pose[2] + mount[2],
    )


def sight_line(scan: Scan, range_min_m: float = 0.0, *, is_open: bool = True) -> SightLine:
    """How far the beams of a scan looked; BLIND where the bearings do not increase.

    range_min_m: a nearer return is a cover on the lens or the vehicle itself. is_open: a beam without return met
    nothing within the laser's range; between walls it met something dark, or a window.
    """
    if scan.ranges_m.size < 2:
        return BLIND
    bearings = scan.bearings_rad
    step = (float(bearings[-1]) - float(bearings[0])) / (bearings.size - 1)
    if not math.isfinite(step) or step <= 0.0:
        return BLIND
    ranges = scan.ranges_m.astype(np.float64)
    ranges[ranges < range_min_m] = 0.0
    no_return_m = float(scan.range_max_m) if is_open else 0.0
    return SightLine(float(bearings[0]), step, no_return_m, ranges, MISSED_SPACING_M / step)


def field_of_view(reach_m: float, half_rad: float, certainty: float = 1.0) -> SightLine:
    """The sight of a sensor that reports things within a range and to an angle to either side."""
    beams = 2 * max(round(half_rad / SIGHTING_STEP_RAD), 1) + 1
    return SightLine(-half_rad, 2.0 * half_rad / (beams - 1), math.inf, np.full(beams, math.inf), reach_m, certainty)


class SensorView:
    """Where the sensor looks: a laser's scan tells it; of what reports things it is learnt from where it saw any."""

    def __init__(self, range_min_m: float) -> None:
        self._range_min_m = range_min_m
        self._reach_m = self._half_rad = 0.0
        self._looks, self._finds = FIRST_LOOKS, FIRST_FINDS
        self._scans, self._empty_share = 0, 0.0

    def of(self, scan: ScanLike, rows: FeatureRows) -> SightLine:
        """How far this scan looked; rows: its features."""
        if isinstance(scan, Scan):
            self._scans += 1
            gain = max(1.0 / self._scans, SLOWEST_GAIN)
            self._empty_share += gain * (float(np.isnan(scan.ranges_m).mean()) - self._empty_share)
            return sight_line(scan, self._range_min_m, is_open=self._empty_share > OPEN_SHARE)
        self._reach_m = max(self._reach_m, float(rows.ranges_m.max(initial=0.0)))
        self._half_rad = max(self._half_rad, float(np.abs(rows.bearings_rad).max(initial=0.0)))
        rate = self._finds / self._looks
        certainty = logarithm((1.0 - CHANCE) / (1.0 - min(max(rate, CHANCE), 0.99)))
        reach_m, half_rad = SIGHTING_SHARE * self._reach_m, max(self._half_rad - SIGHTING_EDGE_RAD, SIGHTING_STEP_RAD)
        return field_of_view(reach_m, half_rad, min(certainty, 1.0))

    def learn(self, found: int, missed: int) -> None:
        """Of the landmarks that have stood for long, how many were found and missed in that scan."""
        fading = min(1.0, MOST_LOOKS / (self._looks + found + missed))
        self._looks, self._finds = fading * (self._looks + found + missed), fading * (self._finds + found)

    def state_bytes(self) -> bytes:
        """What the next scan's sight depends on, for a hash."""
        return struct.pack(
            "<5dq", self._reach_m, self._half_rad, self._looks, self._finds, self._empty_share, self._scans
        )
