"""Geometry and noise of the wheels."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class OdometrySettings(BaseModel):
    """How wheel samples become motion, and how far that motion can be trusted.

    Random walks are given per square root of metre, so that they do not depend on the sampling rate.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: Literal["differential", "steered", "speed_yaw_rate", "pose"] = Field(
        default="differential",
        description="kind of wheel samples: counts, speed and steering, speed and yaw rate, or poses",
    )
    wheel_radius_left_m: float = Field(default=0.125, gt=0, le=2, description="m; 0.125 in Table II of the paper")
    wheel_radius_right_m: float = Field(default=0.125, gt=0, le=2, description="m; 0.125 in Table II of the paper")
    tread_m: float = Field(default=0.5, gt=0, le=5, description="m between the wheels; 0.5 in Table II of the paper")
    counts_per_rev: float = Field(default=4096.0, gt=0, le=1e7, description="counts per revolution of the wheel")
    wheel_base_m: float = Field(default=2.83, gt=0, le=20, description="m from rear to steered axle (steered only)")
    speed_wheel_offset_m: float = Field(
        default=0.76,
        ge=-5,
        le=5,
        description="m by which the wheel whose speed is measured stands left of the centre (steered only)",
    )
    steering_scale: float = Field(
        default=1.0, ge=0.5, le=2, description="true steering angle over measured (steered only)"
    )
    steering_bias_rad: float = Field(
        default=0.0, ge=-0.5, le=0.5, description="rad added after the scale (steered only)"
    )

    slip_m_per_sqrt_m: float = Field(
        default=0.01,
        ge=0,
        le=1,
        description="random slip of each wheel, m per square root of metre rolled; 1 cm in 1 m on gravel",
    )
    lateral_m_per_sqrt_m: float = Field(
        default=0.005,
        ge=0,
        le=1,
        description="sideways drift, m per square root of metre driven; 1 mm in a step of 5 cm",
    )
    heading_rad_per_sqrt_m: float = Field(
        default=0.001,
        ge=0,
        le=1,
        description="turning beyond what the wheels tell, rad per square root of metre driven",
    )
    heading_rad_per_sqrt_rad: float = Field(
        default=0.0, ge=0, le=2, description="error of a turn, rad per square root of radian turned (poses only)"
    )
    radius_uncertainty: float = Field(
        default=0.002, ge=0, le=0.2, description="relative error of each wheel radius, constant in a drive"
    )
    tread_uncertainty: float = Field(
        default=0.01, ge=0, le=0.5, description="relative error of the tread, constant in a drive"
    )
    speed_noise_mps: float = Field(
        default=0.2, ge=0, le=10, description="m/s, white; not applied at rest (speed models only)"
    )
    speed_noise_ratio: float = Field(
        default=0.0, ge=0, le=1, description="share of the speed that is noise as well (speed models only)"
    )
    yaw_rate_noise_radps: float = Field(
        default=0.052, ge=0, le=5, description="rad/s, white; 3 deg/s (speed_yaw_rate only)"
    )
    steering_noise_rad: float = Field(default=0.1, ge=0, le=1, description="rad, white; 6 deg (steered only)")
    noise_time_s: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="s for which one draw of the white noises above lasts: the sampling time they are quoted for",
    )

    rest_tolerance_counts: float = Field(
        default=1.0,
        ge=0,
        le=1000,
        description="counts per scan that still are standing still: an encoder at an edge toggles by one",
    )
    max_speed_mps: float = Field(
        default=40.0, gt=0, le=100, description="m/s beyond which a difference of counts or poses is a jump"
    )
    max_yaw_rate_radps: float = Field(
        default=10.0, gt=0, le=100, description="rad/s beyond which a measured yaw rate is refused"
    )
    gap_s: float = Field(default=0.5, gt=0, le=10, description="s of silence after which motion is unknown")
    gap_speed_mps: float = Field(
        default=0.5, ge=0, le=40, description="m/s, standard deviation of the speed while it is unknown"
    )
    gap_yaw_rate_radps: float = Field(default=0.5, ge=0, le=6, description="rad/s, the same for the yaw rate")
    extrapolation_s: float = Field(
        default=0.1, ge=0, le=1, description="s for which the last speed is carried on past the last sample"
    )
