"""[slam.odometry]: noise of the wheels. Their geometry stands in the table [vehicle], which runtime hands on."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

POSE_NOISE = {
    "slip_m_per_sqrt_m": 0.05,
    "lateral_m_per_sqrt_m": 0.02,
    "heading_rad_per_sqrt_m": 0.03,
    "heading_rad_per_sqrt_rad": 0.1,
}
"""Where the base hands out poses and nobody says how good they are: as wide as in most of the public logs."""


class OdometrySettings(BaseModel):
    """How far the motion that the wheels tell can be trusted.

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
        description="random slip of each wheel, m per square root of metre rolled; 1 cm in 1 m on gravel. Raise it on "
        "looser ground; `infant calibrate` measures it",
    )
    lateral_m_per_sqrt_m: float = Field(
        default=0.005,
        ge=0,
        le=1,
        description="sideways drift, m per square root of metre driven; 1 mm in a step of 5 cm. Raise it on slopes and "
        "with worn tyres; `infant calibrate` measures it",
    )
    heading_rad_per_sqrt_m: float = Field(
        default=0.001,
        ge=0,
        le=1,
        description="turning beyond what the wheels tell, rad per square root of metre driven. Raise it for vehicles "
        "that skid while they turn",
    )
    heading_rad_per_sqrt_rad: float = Field(
        default=0.0,
        ge=0,
        le=2,
        description="error of a turn, rad per square root of radian turned (poses only): what the log's own odometry "
        "errs by, found by comparing turns with its truth",
    )
    radius_uncertainty: float = Field(
        default=0.002,
        ge=0,
        le=0.2,
        description="relative error of each wheel radius, constant in a drive: tyre pressure and load. "
        "`infant calibrate` writes what is left after it",
    )
    tread_uncertainty: float = Field(
        default=0.01,
        ge=0,
        le=0.5,
        description="relative error of the tread, constant in a drive: where a wide tyre touches the ground. "
        "`infant calibrate` writes what is left after it",
    )
    speed_noise_mps: float = Field(
        default=0.2,
        ge=0,
        le=10,
        description="m/s, white; not applied at rest (speed models only). From the sensor's data sheet, or the spread "
        "at constant speed",
    )
    speed_noise_ratio: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="share of the speed that is noise as well (speed models only): for speeds that are commanded and "
        "not measured",
    )
    yaw_rate_noise_radps: float = Field(
        default=0.052,
        ge=0,
        le=5,
        description="rad/s, white; 3 deg/s (speed_yaw_rate only). From the gyro's data sheet, or its spread at rest",
    )
    steering_noise_rad: float = Field(
        default=0.1,
        ge=0,
        le=1,
        description="rad, white; 6 deg (steered only). Spread of the measured angle while driving straight",
    )
    noise_time_s: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="s for which one draw of the white noises above lasts: the sampling time they are quoted for",
    )
    gap_s: float = Field(
        default=0.5,
        gt=0,
        le=10,
        description="s of silence of the wheels after which motion counts as unknown. Longer than the longest usual "
        "gap of the log",
    )
