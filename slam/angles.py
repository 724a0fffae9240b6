"""Angles in compiled code: wrapping, and short series where sigma points lie close together.

A whole arctangent takes longer than all else that is done with a sigma point; the series are exact to 1e-13 rad in the
range they are used in.
"""

import math

from slam.arithmetic.functions import arctangent, cosine_sine
from slam.compiled import leaf

SERIES_LIMIT = 0.15


@leaf
def wrapped(angle: float) -> float:
    """Angle in (-pi, pi], from any number of turns."""
    angle = half_turn(angle)
    if angle > math.pi or angle <= -math.pi:
        angle = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    return angle


@leaf
def half_turn(angle: float) -> float:
    """Wrap an angle that is off by at most one turn."""
    if angle > math.pi:
        return angle - 2.0 * math.pi
    if angle <= -math.pi:
        return angle + 2.0 * math.pi
    return angle


@leaf
def sees_all_round(spacing_rad: float, beams: int) -> bool:
    """Whether the last beam of a scan lies beside the first one."""
    return (beams + 0.5) * spacing_rad > 2.0 * math.pi


@leaf
def beams_after_first(bearing_rad: float, first_rad: float, spacing_rad: float, beams: int) -> float:
    """How many beams after the first one a bearing lies, wherever a laser begins to count: in [-0.5, beams - 0.5) where
    it is seen. What lies in the gap behind is before the first beam or after the last, whichever is nearer.
    """
    gap_rad = max(2.0 * math.pi - beams * spacing_rad, 0.0)
    off_rad = bearing_rad - first_rad
    turns = math.floor((off_rad + 0.5 * (gap_rad + spacing_rad)) / (2.0 * math.pi))
    return (off_rad - 2.0 * math.pi * turns) / spacing_rad


@leaf
def angle_between(x_0: float, y_0: float, x: float, y: float) -> float:
    """Angle in (-pi, pi] by which (x, y) lies counter-clockwise of (x_0, y_0)."""
    across, along = x_0 * y - y_0 * x, x_0 * x + y_0 * y
    if abs(across) < SERIES_LIMIT * along:
        t = across / along
        s = t * t
        tail = 1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0))
        return t * (1.0 - s * (1.0 / 3.0 - s * (0.2 - s * tail)))
    return arctangent(across, along)


@leaf
def cosine_sine_of_step(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle that is small as a rule."""
    if abs(angle) < SERIES_LIMIT:
        s = angle * angle
        cosine = 1.0 - s * (0.5 - s * (1.0 / 24.0 - s * (1.0 / 720.0 - s / 40320.0)))
        sine = angle * (1.0 - s * (1.0 / 6.0 - s * (1.0 / 120.0 - s * (1.0 / 5040.0 - s / 362880.0))))
        return cosine, sine
    return cosine_sine(angle)
