"""[vehicle]: what is a fact of the vehicle, whoever asks: the driver, the filter or a report."""

import math
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

JUMP_FACTOR = 1.5  # times the top speed: what moves faster between two samples is a jump and no motion
POSE_MAX_SPEED_MPS = 26.7


class VehicleSettings(BaseModel):
    """Geometry of the vehicle and how its motion is measured. Used by the wheels' driver and by the filter.

    Take the numbers from drawing and data sheet, drive some loops both ways, and let `infant calibrate RUN`
    correct radii and tread.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    motion_model: Literal["differential", "steered", "speed_yaw_rate", "pose"] = Field(
        default="differential",
        description="What the wheels report: counts of two wheels, speed and steering angle, speed and yaw rate, "
        "or poses of the robot's own odometry. A live rover is differential; for a log, choose what "
        "its columns hold",
    )
    wheel_radius_left_m: float = Field(
        default=0.125,
        gt=0.001,
        le=2.0,
        description="Radius of the left wheel under load; 0.125 in Table II of the paper. Measure it with a ruler; "
        "`infant calibrate` then finds it to 0.1 %",
    )
    wheel_radius_right_m: float = Field(
        default=0.125,
        gt=0.001,
        le=2.0,
        description="Radius of the right wheel under load. Measure it with a ruler; `infant calibrate` then finds it "
        "to 0.1 %",
    )
    tread_m: float = Field(
        default=0.5,
        gt=0.05,
        le=5.0,
        description="Distance between the points where the two wheels touch the ground; 0.5 in Table II of the "
        "paper. Measure it with a ruler; `infant calibrate` then corrects it",
    )
    counts_per_rev: float = Field(
        default=4096.0,
        ge=0.01,
        le=1e7,
        description="Encoder counts for one turn of the wheel, gear included; 1024 lines x 4 on the paper's rover. "
        "Take it from the data sheet; a node that reports its own is compared with it",
    )
    wheel_base_m: float = Field(
        default=2.83,
        ge=0.05,
        le=20.0,
        description="Distance from the rear axle to the steered one (steered only). Take it from the drawing",
    )
    speed_wheel_offset_m: float = Field(
        default=0.76,
        ge=-5.0,
        le=5.0,
        description="Distance to the left of the centre of the wheel whose speed is measured (steered only). Take "
        "it from the drawing",
    )
    steering_scale: float = Field(
        default=1.0,
        ge=0.5,
        le=2.0,
        description="True steering angle divided by the measured one (steered only). `infant calibrate` finds it",
    )
    steering_bias_rad: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="Angle added after the scale (steered only). `infant calibrate` finds it",
    )
    max_speed_mps: float = Field(
        default=1.944,
        gt=0.01,
        le=100.0,
        description="Top speed of a wheel; the default is 7 km/h (paper, Table II), 26.7 m/s for poses. Motion of "
        "1.5 times that speed between two samples counts as a jump: raise it for a faster vehicle, and "
        "for logs whose stamps are coarse",
    )

    @model_validator(mode="after")
    def _poses_may_be_fast(self) -> Self:
        """A base that hands out poses never lost count, and its stamps are rough: only 40 m/s is a jump."""
        if self.motion_model == "pose" and "max_speed_mps" not in self.model_fields_set:
            object.__setattr__(self, "max_speed_mps", POSE_MAX_SPEED_MPS)
        return self

    @property
    def counts_per_metre(self) -> float:
        """Counts for one metre rolled, by the mean of both radii."""
        radius_m = 0.5 * (self.wheel_radius_left_m + self.wheel_radius_right_m)
        return self.counts_per_rev / (2.0 * math.pi * radius_m)

    @property
    def jump_speed_mps(self) -> float:
        """What is faster than this is a jump."""
        return JUMP_FACTOR * self.max_speed_mps
