"""What could be seen from where: the pose of the sensor, the sight line of a scan, a landmark in clear view."""

import math

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike
from slam.angles import wrapped
from slam.compiled import leaf
from slam.settings.tuning import Tuning

NO_SIGHT = np.zeros(3)


@leaf
def in_clear_view(
    landmark_x: float, landmark_y: float, sensor: tuple[float, float, float], sight: FloatArray, tuning: Tuning
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
    beams = sight.size - 3
    if beams <= 0:
        return True
    half_width = math.atan2(tuning.sight_half_width_m, distance) + abs(sight[1])
    first = math.floor((bearing - half_width - sight[0]) / sight[1])
    last = math.ceil((bearing + half_width - sight[0]) / sight[1])
    if first < 0 or last >= beams:
        return False
    for beam in range(first, last + 1):
        measured = sight[3 + beam] if sight[3 + beam] == sight[3 + beam] else sight[2]
        if measured < distance + tuning.sight_margin_m:
            return False
    return True


@leaf
def sensor_pose(pose: FloatArray, mount: FloatArray) -> tuple[float, float, float]:
    """map_from_laser x m, y m, heading rad."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return (
        pose[0] + cosine * mount[0] - sine * mount[1],
        pose[1] + sine * mount[0] + cosine * mount[1],
        pose[2] + mount[2],
    )


def sight_line(scan: ScanLike) -> FloatArray:
    """The scan as slam.kernels takes it, (3 + N,): first bearing, bearing step, range of no return, ranges."""
    if not isinstance(scan, Scan) or scan.ranges_m.size < 2:
        return NO_SIGHT
    bearings = scan.bearings_rad
    step = (float(bearings[-1]) - float(bearings[0])) / (bearings.size - 1)
    if not math.isfinite(step) or step <= 0.0:
        return NO_SIGHT
    return np.concatenate(((float(bearings[0]), step, scan.range_max_m), scan.ranges_m.astype(np.float64)))
