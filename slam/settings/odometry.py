"""[slam.odometry]: noise of the wheels. Their geometry stands in the table [vehicle], which runtime hands on."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

WIDE_NOISE = {
    "pose": {
        "slip_m_per_sqrt_m": 0.05,
        "lateral_m_per_sqrt_m": 0.02,
        "heading_rad_per_sqrt_m": 0.03,
        "heading_rad_per_sqrt_rad": 0.1,
    },
    "speed_yaw_rate": {"speed_noise_mps": 0.05, "speed_noise_ratio": 0.2, "yaw_rate_noise_radps": 0.2},
}
"""By model, where nobody says how good it is: poses as wide as in most of the public logs; speeds as if commanded."""


class OdometrySettings(BaseModel):
    """How far the motion reported by the wheels can be trusted.

    Random walks are given per square root of metre, so that they do not depend on the sampling rate. Find them with
    `infant calibrate`, which writes what a drive shows.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    # geometry: keys of [vehicle], which says what each one means; they are not read from [slam.odometry]
    model: Literal["differential", "steered", "speed_yaw_rate", "pose"] = "differential"
    wheel_radius_left_m: float = Field(default=0.125, gt=0, le=2)
    wheel_radius_right_m: float = Field(default=0.125, gt=0, le=2)
    tread_m: float = Field(default=0.5, gt=0, le=5)
    counts_per_rev: float = Field(default=4096.0, gt=0, le=1e7)
    wheel_base_m: float = Field(default=2.83, gt=0, le=20)
    speed_wheel_offset_m: float = Field(default=0.76, ge=-5, le=5)
    steering_scale: float = Field(default=1.0, ge=0.5, le=2)
    steering_bias_rad: float = Field(default=0.0, ge=-0.5, le=0.5)
    jump_speed_mps: float = Field(default=40.0, gt=0, le=1000)

    slip_m_per_sqrt_m: float = Field(
        default=0.01,
        ge=0,
        le=1,
        description="Random slip of each wheel per square root of metre rolled: 1 cm after 1 m on gravel. Raise it "
        "on looser ground; `infant calibrate` measures it",
    )
    lateral_m_per_sqrt_m: float = Field(
        default=0.005,
        ge=0,
        le=1,
        description="Sideways drift per square root of metre driven: 1 mm in a step of 5 cm. Raise it on slopes "
        "and with worn tyres; `infant calibrate` measures it",
    )
    heading_rad_per_sqrt_m: float = Field(
        default=0.001,
        ge=0,
        le=1,
        description="Turning that the wheels do not show, per square root of metre driven. Raise it for vehicles "
        "that skid as they turn",
    )
    heading_rad_per_sqrt_rad: float = Field(
        default=0.0,
        ge=0,
        le=2,
        description="Error of a turn per square root of radian turned (poses only). Find it by comparing the turns "
        "of the log's odometry with its ground truth",
    )
    radius_uncertainty: float = Field(
        default=0.002,
        ge=0,
        le=0.2,
        description="Relative error of each wheel radius, constant during a drive (tyre pressure, load). `infant "
        "calibrate` writes the error that remains after it",
    )
    tread_uncertainty: float = Field(
        default=0.01,
        ge=0,
        le=0.5,
        description="Relative error of the tread, constant during a drive (where a wide tyre touches the ground). "
        "`infant calibrate` writes the error that remains after it",
    )
    speed_noise_mps: float = Field(
        default=0.2,
        ge=0,
        le=10,
        description="White noise of the speed, none at rest (speed models only). Take it from the sensor's data "
        "sheet, or from the spread at constant speed",
    )
    speed_noise_ratio: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="Additional noise as a fraction of the speed (speed models only). Set it when speeds are "
        "commanded rather than measured",
    )
    yaw_rate_noise_radps: float = Field(
        default=0.052,
        ge=0,
        le=5,
        description="White noise of the yaw rate; the default is 3 deg/s (speed_yaw_rate only). Take it from the "
        "gyro's data sheet, or from its spread at rest",
    )
    steering_noise_rad: float = Field(
        default=0.1,
        ge=0,
        le=1,
        description="White noise of the steering angle; the default is 6 deg (steered only). Take the spread of "
        "the measured angle while driving straight",
    )
    noise_time_s: float = Field(
        default=0.2,
        ge=0.001,
        le=10,
        description="How long one draw of the white noises above lasts. Take the sampling time for which they are "
        "quoted",
    )
    gap_s: float = Field(
        default=0.5,
        ge=0.01,
        le=10,
        description="Silence of the wheels after which their motion counts as unknown. Choose it longer than the "
        "longest usual gap of the log",
    )
