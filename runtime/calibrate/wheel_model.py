"""What the wheels say of the motion, as a function of the parameters that are sought."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.measurements import FloatArray
from runtime.calibrate.dead_reckoning import DeadReckoning, dead_reckoning
from runtime.calibrate.drive_data import CalibrationStart, PoseStart, Start, SteeringStart, WheelSeries
from slam.pose import Pose2

MOUNT_NAMES = ("laser_x_m", "laser_y_m", "laser_yaw_rad", "laser_latency_s")
PRESUMED_TREAD_M = 0.5  # of a base whose wheels nobody sees
# how far from the start the truth may be (standard deviations): wide, they only keep what is not observed finite
MOUNT_PRIOR = (0.5, 0.5, 0.5, 0.15)


class WheelModel(Protocol):
    """Parameters: the model's own first, then MOUNT_NAMES."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, units in them."""

    @property
    def start(self) -> FloatArray:
        """(p,) values to begin with."""

    @property
    def prior(self) -> FloatArray:
        """(p,) standard deviations around them."""

    def dead_reckoning(self, series: WheelSeries, parameters: FloatArray) -> DeadReckoning:
        """Dead reckoning of a drive."""

    def noise_arms(self, parameters: FloatArray) -> FloatArray:
        """(2, 2): rows the two independent errors, columns what each does to distance m and heading rad."""

    def noise_weights(self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray) -> FloatArray:
        """(m, 2): running totals by which the variances of both errors grow, at the times."""

    def quantisation_m2(self, parameters: FloatArray) -> float:
        """Variance of each of the errors above that does not grow."""

    def without_errors(
        self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray, errors_m: FloatArray
    ) -> WheelSeries:
        """The samples as they would be had the errors (n, 2) not happened between times_s (n, 2)."""


@dataclass(frozen=True, slots=True)
class DifferentialModel:
    """Two driven wheels: radii and tread are sought; each wheel slips by itself, in proportion to sqrt(metres)."""

    initial: CalibrationStart

    @property
    def names(self) -> tuple[str, ...]:
        """Radii, tread, mount."""
        return ("wheel_radius_left_m", "wheel_radius_right_m", "tread_m", *MOUNT_NAMES)

    @property
    def start(self) -> FloatArray:
        """As given."""
        initial = self.initial
        wheels = (initial.wheel_radius_left_m, initial.wheel_radius_right_m, initial.tread_m)
        return np.array((*wheels, *_mount(initial.body_from_laser), initial.latency_s))

    @property
    def prior(self) -> FloatArray:
        """A tenth of a radius (a wrong tyre), a fifth of the tread (wheels that scrub)."""
        return np.array((*(self.start[:3] * (0.1, 0.1, 0.2)), *MOUNT_PRIOR))

    def dead_reckoning(self, series: WheelSeries, parameters: FloatArray) -> DeadReckoning:
        """Distance is the mean of both wheels, heading their difference over the tread."""
        travel = self._travel_m(series, parameters)
        return dead_reckoning(series.times_s, travel.mean(axis=1), (travel[:, 1] - travel[:, 0]) / parameters[2])

    def noise_arms(self, parameters: FloatArray) -> FloatArray:
        """A metre of slip of one wheel moves the centre by half a metre."""
        return np.array(((0.5, -1.0 / parameters[2]), (0.5, 1.0 / parameters[2])))

    def noise_weights(self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray) -> FloatArray:
        """Metres rolled by each wheel, whatever the direction."""
        steps = np.abs(np.diff(self._travel_m(series, parameters), axis=0))
        rolled = np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
        return np.stack([np.interp(times_s, series.times_s, rolled[:, wheel]) for wheel in range(2)], axis=-1)

    def quantisation_m2(self, parameters: FloatArray) -> float:
        """Both ends of an increment fall somewhere within a count."""
        count_m = 2.0 * math.pi * float(parameters[:2].mean()) / self.initial.counts_per_rev
        return count_m**2 / 6.0

    def without_errors(
        self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray, errors_m: FloatArray
    ) -> WheelSeries:
        """Each wheel's slip is taken back in proportion to the metres it rolled meanwhile."""
        here = self.noise_weights(series, parameters, series.times_s)
        metres_per_count = parameters[:2] * (2.0 * math.pi / self.initial.counts_per_rev)
        values = series.values.copy()
        for wheel in range(2):
            begin, end = (self.noise_weights(series, parameters, times_s[:, side])[:, wheel] for side in range(2))
            rate = errors_m[:, wheel] / np.maximum(end - begin, 1e-9)
            slipped = _running(here[:, wheel], begin, end, rate)
            values[:, wheel] -= slipped / metres_per_count[wheel]
        return WheelSeries(series.times_s, values, series.broken)

    def _travel_m(self, series: WheelSeries, parameters: FloatArray) -> FloatArray:
        turns = (series.values - series.values[0]) * (2.0 * math.pi / self.initial.counts_per_rev)
        travel_m: FloatArray = turns * parameters[:2]
        return travel_m


@dataclass(frozen=True, slots=True)
class SteeredModel:
    """A steered axle: scale of the speed, scale and bias of the steering; one error forward, one of the heading."""

    initial: SteeringStart

    @property
    def names(self) -> tuple[str, ...]:
        """Speed, steering, mount."""
        return ("speed_scale", "steering_scale", "steering_bias_rad", *MOUNT_NAMES)

    @property
    def start(self) -> FloatArray:
        """As given."""
        initial = self.initial
        steering = (initial.speed_scale, initial.steering_scale, initial.steering_bias_rad)
        return np.array((*steering, *_mount(initial.body_from_laser), initial.latency_s))

    @property
    def prior(self) -> FloatArray:
        """A tenth of the speed, a fifth of the steering, 3 degrees of bias."""
        return np.array((0.1, 0.2, 0.05, *MOUNT_PRIOR))

    def dead_reckoning(self, series: WheelSeries, parameters: FloatArray) -> DeadReckoning:
        """Speed and steering held until the next sample; the speed of a wheel beside the centre is brought to it."""
        speed = series.values[:-1, 0] * parameters[0]
        slope = np.tan(parameters[1] * series.values[:-1, 1] + parameters[2])
        wheel_base = self.initial.wheel_base_m
        steps = speed / (1.0 - slope * self.initial.speed_wheel_offset_m / wheel_base) * np.diff(series.times_s)
        distances = np.concatenate(((0.0,), np.cumsum(steps)))
        headings = np.concatenate(((0.0,), np.cumsum(steps * slope / wheel_base)))
        return dead_reckoning(series.times_s, distances, headings)

    def noise_arms(self, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 (the same for all parameters)
        """Forward metre for metre; a metre sideways at the steered axle turns by 1 / wheel base."""
        return np.array(((1.0, 0.0), (0.0, 1.0 / self.initial.wheel_base_m)))

    def noise_weights(self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray) -> FloatArray:
        """Metres driven, for both."""
        drive = self.dead_reckoning(series, parameters)
        rolled = np.concatenate(((0.0,), np.cumsum(np.abs(np.diff(drive.distances_m)))))
        metres = np.interp(times_s, series.times_s, rolled)
        return np.stack((metres, metres), axis=-1)

    def quantisation_m2(self, parameters: FloatArray) -> float:  # noqa: ARG002 (the same for all parameters)
        """None that is known."""
        return 0.0

    def without_errors(
        self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray, errors_m: FloatArray
    ) -> WheelSeries:
        """Speed and steering are changed for as long as the step lasts."""
        metres = np.diff(self.noise_weights(series, parameters, times_s.ravel())[:, 0].reshape(-1, 2), axis=1)[:, 0]
        shares = errors_m / np.maximum(metres, 0.1)[:, None]
        values = series.values.copy()
        step = np.searchsorted(times_s[:, 0], series.times_s, side="right") - 1
        inside = (step >= 0) & (series.times_s < times_s[np.maximum(step, 0), 1])
        values[inside, 0] *= 1.0 - shares[step[inside], 0]
        values[inside, 1] -= shares[step[inside], 1]
        return WheelSeries(series.times_s, values, series.broken)


@dataclass(frozen=True, slots=True)
class PoseModel:
    """A base that hands out poses: scale of its distances and of its turns; one error forward, one of the heading."""

    initial: PoseStart

    @property
    def names(self) -> tuple[str, ...]:
        """Scales, mount."""
        return ("distance_scale", "turn_scale", *MOUNT_NAMES)

    @property
    def start(self) -> FloatArray:
        """As given."""
        initial = self.initial
        scales = (initial.distance_scale, initial.turn_scale)
        return np.array((*scales, *_mount(initial.body_from_laser), initial.latency_s))

    @property
    def prior(self) -> FloatArray:
        """A tenth of the distance, a fifth of the turns."""
        return np.array((0.1, 0.2, *MOUNT_PRIOR))

    def dead_reckoning(self, series: WheelSeries, parameters: FloatArray) -> DeadReckoning:
        """Its own, stretched."""
        return dead_reckoning(series.times_s, *(series.values * parameters[:2]).T)

    def noise_arms(self, parameters: FloatArray) -> FloatArray:  # noqa: ARG002 (the same for all parameters)
        """Forward metre for metre; the heading as if wheels half a metre apart had slipped."""
        return np.array(((1.0, 0.0), (0.0, 1.0 / PRESUMED_TREAD_M)))

    def noise_weights(self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray) -> FloatArray:
        """Metres driven; those and what the presumed wheels roll in turns."""
        steps = np.abs(np.diff(series.values * parameters[:2], axis=0))
        rolled = np.stack((steps[:, 0], steps[:, 0] + PRESUMED_TREAD_M * steps[:, 1]), axis=-1)
        totals = np.vstack((np.zeros((1, 2)), np.cumsum(rolled, axis=0)))
        return np.stack([np.interp(times_s, series.times_s, totals[:, error]) for error in range(2)], axis=-1)

    def quantisation_m2(self, parameters: FloatArray) -> float:  # noqa: ARG002 (the same for all parameters)
        """None that is known."""
        return 0.0

    def without_errors(
        self, series: WheelSeries, parameters: FloatArray, times_s: FloatArray, errors_m: FloatArray
    ) -> WheelSeries:
        """Distance and heading are changed in proportion to the way meanwhile."""
        here = self.noise_weights(series, parameters, series.times_s)
        arms = np.diag(self.noise_arms(parameters))
        values = series.values.copy()
        for error in range(2):
            begin, end = (self.noise_weights(series, parameters, times_s[:, side])[:, error] for side in range(2))
            rate = errors_m[:, error] * arms[error] / np.maximum(end - begin, 1e-9)
            values[:, error] -= _running(here[:, error], begin, end, rate) / parameters[error]
        return WheelSeries(series.times_s, values, series.broken)


def model_of(initial: Start) -> WheelModel:
    """The model that begins there."""
    if isinstance(initial, SteeringStart):
        return SteeredModel(initial)
    return PoseModel(initial) if isinstance(initial, PoseStart) else DifferentialModel(initial)


def _running(at: FloatArray, begin: FloatArray, end: FloatArray, rate: FloatArray) -> FloatArray:
    """Integral up to `at` of a rate that holds from each begin to its end (in order) and is zero elsewhere."""
    knots = np.stack((begin, end), axis=-1).ravel()
    totals = np.cumsum(np.stack((np.zeros_like(rate), rate * (end - begin)), axis=-1).ravel())
    return np.interp(at, knots, totals)


def _mount(mount: Pose2) -> tuple[float, float, float]:
    return mount.x_m, mount.y_m, mount.heading_rad
