"""Whether a drive held enough of every motion, and what to drive when it did not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.calibrate.scans.laser_motion import LaserMotion
from runtime.calibrate.step_errors import body_steps
from runtime.calibrate.wheel_model import WheelModel

STRAIGHT_RAD_PER_M = 0.1  # gentler than a bend of 10 m radius


@dataclass(frozen=True, slots=True)
class MotionCoverage:
    """One kind of motion: how much there was, how much is wanted, and what to do for more."""

    name: str
    have: float
    want: float
    unit: str
    advice: str

    @property
    def short(self) -> bool:
        """True if there was too little."""
        return not self.have >= self.want

    def sentence(self) -> str:
        """The advice with the figures; what there was is rounded down, so that too little never looks like enough."""
        have = np.floor(10.0 * self.have) / 10.0
        return f"{self.advice}: {self.name} was {have:.1f} {self.unit}, and {self.want:g} are needed"


def measures(
    motions: Sequence[LaserMotion], model: WheelModel, parameters: FloatArray, used: FloatArray, still_scans: int
) -> tuple[MotionCoverage, ...]:
    """What the drives held. used (n,): 1 for the steps that wheels and laser agree on, 0 for the others."""
    rows = [_rows(motion, model, parameters) for motion in motions]
    table = np.concatenate(rows) * used[:, None]
    distance, turn, change = np.abs(table[:, 0]), table[:, 1], np.abs(table[:, 2])
    straight = distance[np.abs(turn) <= STRAIGHT_RAD_PER_M * distance].sum()
    return (
        MotionCoverage(
            "distance seen by the laser", float(distance.sum()), 15.0, "m", "drive farther where the laser sees things"
        ),
        MotionCoverage("straight driving", float(straight), 4.0, "m", "drive a straight stretch"),
        MotionCoverage("turning left", float(turn[turn > 0.0].sum()), 2.5, "rad", "turn more to the left"),
        MotionCoverage("turning right", float(-turn[turn < 0.0].sum()), 2.5, "rad", "turn more to the right"),
        MotionCoverage(
            "change of speed and turning",
            float(change.sum()),
            3.0,
            "m/s",
            "start, stop, and go in and out of turns more often",
        ),
        MotionCoverage("standstill", float(still_scans), 10.0, "scans", "stand still for two seconds"),
    )


def _rows(motion: LaserMotion, model: WheelModel, parameters: FloatArray) -> FloatArray:
    """(n, 3): metres, radians, and change of wheel speed m/s from begin to end of each step."""
    steps = body_steps(motion, model, parameters)
    times = motion.times_s - parameters[-1]
    velocities = model.dead_reckoning(motion.series, parameters).velocity(times.ravel(), 0.2).reshape(-1, 2, 2)
    change = np.diff(velocities, axis=1)[:, 0]
    # half a metre from the centre a change of the yaw rate is worth so much speed
    changes = np.abs(change[:, 0]) + 0.5 * np.abs(change[:, 1])
    return np.stack((np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2], changes), axis=-1)
