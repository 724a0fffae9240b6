"""One sweep, corrected for the motion of the rover while it was measured."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from drivers.measurements import FloatArray, Scan, ScanLike
from slam.angles import wrapped
from slam.arithmetic.functions import arctangent, cosine_sine, cosines_sines
from slam.compiled import kernel
from slam.observations import Features
from slam.pose import Pose2

NEAREST_M = 0.1  # below this a direction means nothing
UNTIMED_S = 0.01  # where a scan does not tell when each beam was taken: a sweep takes about twice as long
LARGEST_SPAN_RAD = 4.0 * math.pi  # of one sweep; in degrees every laser would see more


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the body in its own frame, held over one sweep."""

    speed_mps: float = 0.0
    lateral_mps: float = 0.0
    yaw_rate_radps: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """What the beams of one scan hit, in the laser's frame at the scan's stamp.

    ranges_m, bearings_rad (n,) and points_m (n, 2): NaN where nothing usable came back.
    rays (n, 2): unit vectors to where every beam pointed, empty ones as well; counter-clockwise.
    spacing_rad: angle from one beam to the next.
    """

    stamp_ns: int
    ranges_m: FloatArray
    bearings_rad: FloatArray
    points_m: FloatArray
    rays: FloatArray
    spacing_rad: float

    def __len__(self) -> int:
        return int(self.ranges_m.shape[0])


def deskew(scan: Scan, twist: Twist, body_from_laser: Pose2, range_min_m: float, range_max_m: float) -> Beams:
    """Beams as if all of them had been measured at the scan's stamp.

    Ranges that are not finite, below range_min_m or not below range_max_m count as no return.
    Raises ValueError when the bearings do not increase.
    """
    count = scan.ranges_m.shape[0]
    directions = scan.bearings_rad
    spacing = (directions[-1] - directions[0]) / (count - 1) if count > 1 else 2.0 * math.pi
    if not spacing > 0.0 or (count > 1 and not np.all(directions[1:] > directions[:-1])):
        raise ValueError(
            f"bearings_rad from {directions[0]} to {directions[-1]} do not increase; expected "
            "counter-clockwise beams: reverse the arrays of the scan"
        )
    if not spacing * count < LARGEST_SPAN_RAD:
        raise ValueError(
            f"bearings_rad from {directions[0]:g} to {directions[-1]:g} span more than two turns; expected radians"
        )
    beams = BeamArrays(np.empty(count), np.empty(count), np.empty((count, 2)), np.empty((count, 2)))
    sweep = Sweep(scan.ranges_m.astype(np.float64), directions, scan.beam_period_s, scan.stamp_beam)
    _deskew(
        sweep,
        np.array((twist.speed_mps, twist.lateral_mps, twist.yaw_rate_radps)),
        body_from_laser.as_array(),
        range_min_m,
        min(range_max_m, scan.range_max_m),
        beams,
    )
    return Beams(scan.stamp_ns, *beams, float(spacing))


def sharp_to_m(scan: Scan, twist: Twist, blur_m: float) -> float:
    """Range up to which returns stand where they seem to, to blur_m, though the rover turned in the sweep.

    Scans that tell when each beam was taken are deskewed; those of most logs do not. inf where nothing is blurred.
    """
    turned_rad = 0.0 if scan.beam_period_s != 0.0 else abs(twist.yaw_rate_radps) * UNTIMED_S
    return blur_m / turned_rad if turned_rad > 0.0 else math.inf


def with_motion_noise(features: Features, scan: ScanLike, covariance: FloatArray, duration_s: float) -> Features:
    """Features as uncertain as the motion by which they were deskewed.

    covariance (3, 3) of the motion over duration_s, body frame: a feature that was measured a part of this time
    away from the stamp takes that part of it. Without it the features of one sweep contradict each other by more
    than they claim: the wheels' slip within 75 ms turns the view by more than a beam's width.
    """
    if not isinstance(scan, Scan) or scan.beam_period_s == 0.0 or duration_s <= 0.0 or len(features) == 0:
        return features
    away_s = np.abs((features.beams - scan.stamp_beam) * scan.beam_period_s)
    share = np.where(features.beams >= 0, np.minimum(away_s / duration_s, 1.0), 0.0)
    cosine, sine = cosines_sines(features.bearings_rad)
    xx, xy, yy, turned = covariance[0, 0], covariance[0, 1], covariance[1, 1], covariance[2, 2]
    along = cosine * cosine * xx + 2.0 * cosine * sine * xy + sine * sine * yy
    across = sine * sine * xx - 2.0 * cosine * sine * xy + cosine * cosine * yy
    wider = features.covariances.copy()
    wider[:, 0, 0] += share * along
    wider[:, 1, 1] += share * (turned + across / np.square(np.maximum(features.ranges_m, NEAREST_M)))
    return replace(features, covariances=wider)


class Sweep(NamedTuple):
    """A scan as it was measured: ranges m and directions rad (n,), and when each beam was taken."""

    ranges_m: FloatArray
    directions_rad: FloatArray
    beam_period_s: float
    stamp_beam: int


class BeamArrays(NamedTuple):
    """The arrays of Beams, to be filled in."""

    ranges_m: FloatArray
    bearings_rad: FloatArray
    points_m: FloatArray
    rays: FloatArray


@kernel
def _deskew(
    sweep: Sweep, twist: FloatArray, mount: FloatArray, range_min_m: float, range_max_m: float, beams: BeamArrays
) -> None:
    measured_m, directions_rad, beam_period_s, stamp_beam = sweep
    ranges_m, bearings_rad, points_m, rays = beams
    mount_cosine, mount_sine = cosine_sine(mount[2])
    moving = beam_period_s != 0.0 and (twist[0] != 0.0 or twist[1] != 0.0 or twist[2] != 0.0)
    for beam in range(measured_m.shape[0]):
        delay = (beam - stamp_beam) * beam_period_s
        turn = twist[2] * delay
        ray_x, ray_y = cosine_sine(directions_rad[beam])
        cosine, sine = cosine_sine(turn)
        rays[beam, 0], rays[beam, 1] = cosine * ray_x - sine * ray_y, sine * ray_x + cosine * ray_y
        measured = measured_m[beam]
        if not (range_min_m <= measured < range_max_m):
            ranges_m[beam] = bearings_rad[beam] = points_m[beam, 0] = points_m[beam, 1] = np.nan
            continue
        x, y = measured * ray_x, measured * ray_y
        if not moving:
            ranges_m[beam], bearings_rad[beam] = measured, directions_rad[beam]
            points_m[beam, 0], points_m[beam, 1] = x, y
            continue
        # Along a circular arc: the chord has the direction of half the turn and is shorter by sin(h)/h.
        half = 0.5 * turn
        half_cosine, half_sine = cosine_sine(half)
        chord = delay * (1.0 - half * half / 6.0 if abs(half) < 1e-3 else half_sine / half)
        moved_x = chord * (half_cosine * twist[0] - half_sine * twist[1])
        moved_y = chord * (half_sine * twist[0] + half_cosine * twist[1])
        body_x = mount[0] + mount_cosine * x - mount_sine * y
        body_y = mount[1] + mount_sine * x + mount_cosine * y
        lever_x = moved_x + cosine * body_x - sine * body_y - mount[0]
        lever_y = moved_y + sine * body_x + cosine * body_y - mount[1]
        x = mount_cosine * lever_x + mount_sine * lever_y
        y = mount_cosine * lever_y - mount_sine * lever_x
        points_m[beam, 0], points_m[beam, 1] = x, y
        ranges_m[beam] = math.sqrt(x * x + y * y)
        bearings_rad[beam] = directions_rad[beam] + wrapped(arctangent(y, x) - directions_rad[beam])
