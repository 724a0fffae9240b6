"""How the laser hangs on the rover: upside down, backwards or sideways, where wheels and scans agree only so."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from runtime.calibrate.dead_reckoning import seen_by_laser
from runtime.calibrate.drive_data import CalibrationStart, DriveData, Start
from runtime.calibrate.scans.laser_motion import LaserMotion, laser_motion
from runtime.calibrate.scans.shapes import Shapes
from runtime.calibrate.wheel_model import WheelModel, model_of
from slam.pose import Pose2, composed, inverted, wrap_rads

TRIED_STEPS = 150  # of each drive show it
AGREEING = 0.5  # share of the steps from which on the laser looks where it is believed to
ENOUGH = 0.4  # share of the steps that must agree for another orientation to be believed, ...
CLEARLY = 2.0  # ... and how many times as many as in the one before
LEAST_TURN_RAD = 0.06  # of a step that tells left from right
LEAST_TURNS = 8
ALLOWED_M, ALLOWED_RAD, ALLOWED_SHARE = (
    0.05,
    0.05,
    0.25,
)  # an unknown mount and slipping wheels are no other orientation


@dataclass(frozen=True, slots=True)
class Orientation:
    """Against what is believed: mirrored (left and right exchanged), turned_rad (to the left)."""

    mirrored: bool = False
    turned_rad: float = 0.0


AS_BELIEVED = Orientation()
UPSIDE_DOWN = Orientation(mirrored=True)
WRONG_SIGNS = Orientation(mirrored=True, turned_rad=math.pi)
BACKWARDS_AND_SIDEWAYS = (math.pi, 0.5 * math.pi, -0.5 * math.pi)
OTHERS = (
    UPSIDE_DOWN,
    *(Orientation(mirrored, turned_rad) for mirrored in (False, True) for turned_rad in BACKWARDS_AND_SIDEWAYS),
)
"""In the order in which they are tried."""


def orientation(
    drives: Sequence[DriveData],
    start: Start,
    others: Sequence[Orientation] = OTHERS,
    seen: Sequence[dict[int, Shapes]] | None = None,
) -> Orientation:
    """The first orientation in which wheels and laser agree; what is believed where there is none.

    What agrees without turns may still be mirrored, but looks where it should. seen: gets the shapes that were found in
    each drive as it is believed to be, for laser_motion.
    """
    believed = agreement(drives, model_of(start), seen)
    looks_right = believed.share >= AGREEING
    if looks_right and believed.turns >= LEAST_TURNS:
        return AS_BELIEVED
    for other in others:
        if looks_right and other.turned_rad:
            continue
        if other == WRONG_SIGNS and isinstance(start, CalibrationStart):
            continue  # more likely both wheels count backwards, which looks the same
        turned, begun = oriented(drives, start, other)
        found = agreement(turned, model_of(begun))
        clearly = found.steps >= LEAST_TURNS and found.share >= CLEARLY * believed.share
        if other.mirrored:
            clearly = found.turns >= max(LEAST_TURNS, CLEARLY * believed.turns) and found.share >= believed.share
        if clearly and found.share >= ENOUGH:
            return other
    return AS_BELIEVED


def oriented(drives: Sequence[DriveData], start: Start, found: Orientation) -> tuple[Sequence[DriveData], Start]:
    """Drives and start as they are in this orientation."""
    if found.mirrored:
        drives = [replace(drive, scans=tuple(scan.mirrored() for scan in drive.scans)) for drive in drives]
    heading = float(wrap_rads(np.array(start.body_from_laser.heading_rad + found.turned_rad)))
    mount = Pose2(start.body_from_laser.x_m, start.body_from_laser.y_m, heading)
    return drives, replace(start, body_from_laser=mount)


@dataclass(frozen=True, slots=True)
class Agreement:
    """share: of the steps tried, those on which wheels and laser agree, or of those that turned if it is less: a
    straight way looks the same in a mirror. steps, turns: how many of each agree.
    """

    share: float
    steps: int
    turns: int


def agreement(
    drives: Sequence[DriveData], model: WheelModel, seen: Sequence[dict[int, Shapes]] | None = None
) -> Agreement:
    """How far the laser's own account of the drives is what the wheels say. seen: as laser_motion takes it."""
    tried = 0
    agree, turned = np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.bool_)
    for drive, shapes in zip(drives, seen or [{} for _ in drives], strict=True):
        motion = laser_motion(drive, model, model.start, TRIED_STEPS, shapes)
        told = _told(motion, model)
        tried += len(told) + motion.failed
        agree = np.append(agree, _agreeing(told, motion.means))
        turned = np.append(turned, np.abs(told[:, 2]) > LEAST_TURN_RAD)
    share = agree.sum() / max(tried, 1)
    if turned.sum() >= LEAST_TURNS:
        share = min(share, agree[turned].mean())
    return Agreement(float(share), int(agree.sum()), int(agree[turned].sum()))


def _told(motion: LaserMotion, model: WheelModel) -> FloatArray:
    """(n, 3) the motion of the laser as the wheels tell it."""
    poses = model.dead_reckoning(motion.series, model.start).at(motion.times_s.ravel() - model.start[-1])
    return seen_by_laser(composed(inverted(poses[::2]), poses[1::2]), model.start[-4:-1])


def _agreeing(told: FloatArray, seen: FloatArray) -> BoolArray:
    """(n,) which steps, (n, 3) each, are the same but for an unknown mount and wheels that slip."""
    off_m, off_rad = np.hypot(*(told - seen)[:, :2].T), np.abs(wrap_rads(told[:, 2] - seen[:, 2]))
    turned = np.abs(told[:, 2])
    allowed_m = ALLOWED_M + ALLOWED_SHARE * (np.hypot(*told[:, :2].T) + turned)  # the mount may be half a metre off
    agreeing: BoolArray = (off_m < allowed_m) & (off_rad < ALLOWED_RAD + ALLOWED_SHARE * turned)
    return agreeing
