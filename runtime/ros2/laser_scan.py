"""A scan as sensor_msgs/LaserScan, the way REP 117 and its own comments want it."""

import numpy as np

from drivers.measurements import RangeArray, Scan
from runtime.messages.definitions import construct, serialize
from runtime.messages.ros import header
from runtime.ros2.vehicle import Vehicle

SCAN = "sensor_msgs/msg/LaserScan"


def scan_bytes(scan: Scan, wall_offset_ns: int, vehicle: Vehicle, beam_step: int = 1) -> bytes:
    """Every beam_step-th beam. header.stamp is when ranges[0] was measured, and time_increment is not negative.

    wall_offset_ns is added to the scan's stamp. scan_time is the time from one scan to the next.
    """
    ranges_m, bearings_rad, first = scan.ranges_m, scan.bearings_rad, scan.stamp_beam
    if scan.beam_period_s < 0.0:  # the last beam came first
        ranges_m, bearings_rad, first = ranges_m[::-1], bearings_rad[::-1], ranges_m.size - 1 - first
    period_s = abs(scan.beam_period_s)
    ranges_m, bearings_rad = ranges_m[::beam_step], bearings_rad[::beam_step]
    beams = bearings_rad.size
    first_rad, last_rad = (float(bearings_rad[0]), float(bearings_rad[-1])) if beams else (0.0, 0.0)
    stamp_ns = first_ray_ns(scan) + wall_offset_ns
    message = construct(
        SCAN,
        header=header(stamp_ns, vehicle.frames("laser")),
        angle_min=first_rad,
        angle_max=last_rad,
        angle_increment=(last_rad - first_rad) / (beams - 1) if beams > 1 else 0.0,
        time_increment=period_s * beam_step,
        scan_time=vehicle.scan_period_s,
        range_min=vehicle.range_min_m,
        range_max=scan.range_max_m,
        ranges=rep117(ranges_m),
        intensities=np.empty(0, np.float32),
    )
    return serialize(SCAN, message)


def first_ray_ns(scan: Scan) -> int:
    """When the ray was measured that came first."""
    first = scan.ranges_m.size - 1 - scan.stamp_beam if scan.beam_period_s < 0.0 else scan.stamp_beam
    return scan.stamp_ns - round(first * abs(scan.beam_period_s) * 1e9)


def rep117(ranges_m: RangeArray) -> RangeArray:
    """+inf for a beam within whose range nothing was; NaN throughout where the laser saw nothing at all.

    The drivers tell no beam without a return from the other, so that a weak echo counts as nothing within range; a
    scan without a single return is taken for a laser that is covered, which clears no obstacle.
    """
    absent = np.isnan(ranges_m)
    if absent.all():
        return np.ascontiguousarray(ranges_m)
    return np.where(absent, np.float32(np.inf), ranges_m)
