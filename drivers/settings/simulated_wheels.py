"""Settings of the simulated wheel nodes: the encoders, their errors, and faults from the start."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

WheelFaultKind = Literal[
    "loss",
    "duplicate",
    "reorder",
    "bad_crc",
    "bad_length",
    "remote",
    "fd",
    "extended",
    "alive_frozen",
    "second_sender",
    "silence",
    "silence_all",
    "status",
    "stuck",
    "jump",
    "power_cycle",
    "wrong_counts_per_rev",
    "bus_off",
    "error_passive",
    "error_warning",
    "error_flood",
    "burst",
    "slip",
]


class WheelFault(BaseModel):
    """One fault of the wheel nodes; lasts until it is cleared or its time is over."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: WheelFaultKind = Field(description="what goes wrong")
    wheel: Literal["left", "right", "both"] = Field(default="left", description="whose frames")
    start_s: float = Field(default=0.0, ge=0.0, le=86400.0, description="seconds until it begins")
    duration_s: float = Field(default=0.0, ge=0.0, le=3600.0, description="seconds until it ends by itself; 0: never")
    probability: float = Field(
        default=1.0,
        ge=0.0,
        le=1.0,
        description="part of the frames that are hit",
    )
    magnitude: float = Field(
        default=5000.0,
        ge=-1e9,
        le=1e9,
        description="counts of a jump, offset of a second sender, frames of a burst",
    )
    share: float = Field(
        default=0.3, ge=-1.0, le=10.0, description="for slip: how much farther the wheel turns than it moves the rover"
    )
    value: int = Field(default=2, ge=0, le=65535, description="status that is sent, or the wrong counts per turn")


class SimulatedWheelSettings(BaseModel):
    """Two encoder nodes on one bus that use the layout of [encoders.layout]."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    counts_per_rev: float = Field(default=4096.0, ge=0.01, le=1e7, description="1024 lines x 4")
    wheel_radius_m: float = Field(default=0.125, gt=0.001, le=5.0, description="nominal radius; paper, Table II")
    left_radius_factor: float = Field(
        default=1.0, gt=0.5, lt=2.0, description="true left radius over the nominal; wear and air pressure"
    )
    right_radius_factor: float = Field(default=1.0, gt=0.5, lt=2.0, description="the same on the right")
    slip_std_per_m: float = Field(
        default=0.01,
        ge=0.0,
        le=0.5,
        description="Standard deviation that slip adds per square root of metre driven. Set 0 if every count must "
        "be accounted for",
    )
    start_count: int = Field(
        default=0xFFFFFF00,
        ge=0,
        le=0xFFFFFFFF,
        description="first count; near the top, so that every run wraps",
    )
    start_boot_id: int = Field(default=1, ge=0, le=15, description="first boot id; one more with each power cycle")
    period_ms: float = Field(default=20.0, ge=1.0, le=1000.0, description="time between two frames of one wheel")
    info_period_s: float = Field(default=1.0, ge=0.05, le=60.0, description="time between two INFO messages")
    right_delay_ms: float = Field(
        default=0.7,
        ge=0.0,
        le=20.0,
        description="the right node sends this much after the left one; as in the candump",
    )
    jitter_ms: float = Field(
        default=0.3,
        ge=0.0,
        le=10.0,
        description="standard deviation of the moment of sending and counting",
    )
    faults: tuple[WheelFault, ...] = Field(
        default=(),
        description='Faults that come by themselves, such as `[{ kind = "slip", wheel = "left", start_s = 10, '
        "duration_s = 2, share = 0.3 }]`; `help` in `infant sim` lists them. Set it for a test that has to fail in the "
        "same way each time",
    )
