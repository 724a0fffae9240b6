"""From ordinary drives to wheels, mount, latency and noise, each with its interval; no truth is needed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, OdometryPose, SpeedSteering, WheelCounts
from runtime.calibrate.drive_data import CalibrationStart, DriveData, PoseStart, Start, SteeringStart, check_drives
from runtime.calibrate.result import Calibration, Quantity
from runtime.calibrate.richness import MotionCoverage, measures
from runtime.calibrate.scans.laser_motion import LaserMotion, laser_motion
from runtime.calibrate.scans.orientation import AS_BELIEVED, OTHERS, Orientation, orientation, oriented
from runtime.calibrate.scans.range_noise import RangeNoise, range_noise
from runtime.calibrate.scans.shapes import Shapes
from runtime.calibrate.single_causes import Fit
from runtime.calibrate.solve import LATENCY_BOUND_S, Solution, solve
from runtime.calibrate.wheel_model import DifferentialModel, WheelModel, model_of
from runtime.errors import DataSetError

PASSES = 3  # matching needs the motion within a sweep, which the first pass knows only roughly
SETTLED = 0.2  # of a standard deviation
FEWEST_STEPS = 15
AGREEING_SHARE = 0.4
FARTHEST = 3.0  # deviations of the prior
NORMAL_95 = 1.96
MOTION_MODELS: dict[type[Start], str] = {
    CalibrationStart: "differential",
    SteeringStart: "steered",
    PoseStart: "pose",
}
STARTS: dict[type, type[Start]] = {
    WheelCounts: CalibrationStart,
    SpeedSteering: SteeringStart,
    OdometryPose: PoseStart,
}
HELD: dict[type, str] = {
    WheelCounts: "wheel counts",
    SpeedSteering: "speed and steering",
    OdometryPose: "odometry poses",
}


@dataclass(frozen=True, slots=True)
class _Need:
    """Widest half interval that is worth reporting (relative: share of the value), and the motions that narrow it."""

    widest: float
    relative: bool
    motions: tuple[str, ...]


NEEDS = {
    "wheel_radius_left_m": _Need(0.03, True, ("distance seen by the laser", "straight driving")),
    "wheel_radius_right_m": _Need(0.03, True, ("distance seen by the laser", "straight driving")),
    "tread_m": _Need(0.08, True, ("turning left", "turning right")),
    "laser_x_m": _Need(0.06, False, ("turning left", "turning right")),
    "laser_y_m": _Need(0.06, False, ("turning left", "turning right", "straight driving")),
    "laser_yaw_rad": _Need(0.05, False, ("straight driving",)),
    "laser_latency_s": _Need(0.06, False, ("change of speed and turning",)),
    "speed_scale": _Need(0.03, True, ("distance seen by the laser",)),
    "distance_scale": _Need(0.03, True, ("distance seen by the laser",)),
    "turn_scale": _Need(0.05, True, ("turning left", "turning right")),
    "steering_scale": _Need(0.08, True, ("turning left", "turning right")),
    "steering_bias_rad": _Need(0.01, False, ("straight driving", "distance seen by the laser")),
}


def calibrate(drives: Sequence[DriveData], initial: Start, orientations: Sequence[Orientation] = OTHERS) -> Calibration:
    """Calibrate from all drives together. What they do not show is refused with a reason, never guessed.

    Scans are those of an upright laser, as far as is believed; where wheels and laser agree only if it hangs the other
    way up, or looks elsewhere, the result says so and is the calibration of that. orientations: what is tried then.
    Raises DataSetError where there are no drives, scans or wheels, or the wheels are of another kind than `initial`.
    """
    check_drives(drives)
    _check_kind(drives, initial)
    seen: list[dict[int, Shapes]] = [{} for _ in drives]
    hangs = orientation(drives, initial, orientations, seen)
    drives, initial = oriented(drives, initial, hangs)
    model = model_of(initial)
    values = model.start
    motions, solution = _matched_and_solved(drives, model, values, seen if hangs == AS_BELIEVED else None)
    for _ in range(PASSES - 1):
        if solution.kept.sum() < FEWEST_STEPS:
            break
        before, values = values, solution.parameters
        motions, solution = _matched_and_solved(drives, model, values)
        moved = np.abs(solution.parameters - values) / np.sqrt(np.diag(solution.covariance))
        if before is not model.start and (moved < SETTLED).all():
            break
    noise = range_noise(drives)
    found = measures(motions, model, solution.parameters, solution.kept.astype(np.float64), noise.still_scans)
    trouble, contradicts_start = _trouble(motions, model, solution)
    steps = int(solution.kept.sum())
    quantities = (*_geometry(model, solution, found, trouble), *_noise(model, solution, noise, trouble))
    return Calibration(
        tuple(drive.name for drive in drives),
        quantities,
        found,
        (*((trouble,) if trouble else ()), *(measure.sentence() for measure in found if measure.short)),
        steps,
        int((~solution.kept).sum()),
        sum(motion.failed for motion in motions),
        None if trouble else Fit(model.names, model.start, solution.parameters, solution.covariance, steps),
        contradicts_start,
        hangs,
    )


def _check_kind(drives: Sequence[DriveData], initial: Start) -> None:
    """Raise DataSetError where the wheels are not what the motion model asks for."""
    model = MOTION_MODELS[type(initial)]
    for drive in drives:
        kind = type(drive.wheels[0])
        if MOTION_MODELS[STARTS[kind]] != model:
            raise DataSetError(
                f"{drive.name}: holds {HELD[kind]}, which does not match vehicle.motion_model = {model!r}; "
                "change the configuration"
            )


def _matched_and_solved(
    drives: Sequence[DriveData],
    model: WheelModel,
    values: FloatArray,
    seen: Sequence[dict[int, Shapes]] | None = None,
) -> tuple[list[LaserMotion], Solution]:
    known = seen or [{} for _ in drives]
    motions = [laser_motion(drive, model, values, seen=shapes) for drive, shapes in zip(drives, known, strict=True)]
    return motions, solve(motions, model)


def _trouble(motions: Sequence[LaserMotion], model: WheelModel, solution: Solution) -> tuple[str, bool]:
    """Why nothing of it can be believed, "" if it can; and whether that is because it contradicts the start."""
    steps, kept = len(solution.kept), int(solution.kept.sum())
    tried = steps + sum(motion.failed for motion in motions)
    if tried >= FEWEST_STEPS and kept < AGREEING_SHARE * tried:
        return (
            f"wheels and laser agree on {kept} of {tried} steps, expected {AGREEING_SHARE:.0%}; drive where the laser "
            "sees things that stand still, and check counts per revolution and sign of both wheels"
        ), True
    if kept < FEWEST_STEPS:
        return (
            f"only {kept} steps could be matched, expected at least {FEWEST_STEPS}; "
            "drive farther where the laser sees things"
        ), False
    away = np.abs(solution.parameters - model.start) / model.prior
    if away.max() > FARTHEST or abs(solution.parameters[-1]) >= LATENCY_BOUND_S:
        worst = int(np.argmax(away))
        return (
            f"{model.names[worst]} came out as {solution.parameters[worst]:.4g}, too far from {model.start[worst]:.4g} "
            "to be wear; check the configuration's geometry and counts per revolution, and calibrate again"
        ), True
    return "", False


def _geometry(model: WheelModel, solution: Solution, found: Sequence[MotionCoverage], trouble: str) -> list[Quantity]:
    deviations = np.sqrt(np.diag(solution.covariance))
    quantities = []
    for name, value, deviation, prior in zip(model.names, solution.parameters, deviations, model.prior, strict=True):
        half = NORMAL_95 * float(deviation)
        need = NEEDS[name]
        widest = need.widest * (abs(float(value)) if need.relative else 1.0)
        refused = trouble
        if not refused and (half > widest or deviation > 0.5 * prior):
            short = [measure.advice for measure in found if measure.name in need.motions and measure.short]
            remedy = ", ".join(short) if short else "drive longer"
            refused = f"the drive determines it only to +-{half:.3g}, expected at most {widest:.3g}; {remedy}"
        quantities.append(Quantity(name, float(value), float(value) - half, float(value) + half, refused))
    return quantities


def _noise(model: WheelModel, solution: Solution, noise: RangeNoise, trouble: str) -> list[Quantity]:
    quantities = []
    if isinstance(model, DifferentialModel):
        slip, least, most = (float(solution.noise[0]), 0.0, 0.0) if trouble else solution.slip()
        quantities.append(Quantity("slip_m_per_sqrt_m", slip, least, most, trouble))
        most = 0.0 if trouble else solution.most_drift()
        quantities.append(Quantity("lateral_m_per_sqrt_m", float(solution.noise[1]), 0.0, most, trouble))
    if noise.sigma_m is None:
        why = "no standstill with varying ranges; stand still for two seconds where the laser sees things"
        quantities.append(Quantity("range_noise_m", 0.0, 0.0, 0.0, why))
    else:
        quantities.append(Quantity("range_noise_m", noise.sigma_m, noise.low_m, noise.high_m))
    return quantities
