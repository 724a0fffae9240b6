"""Settings of the wheel encoders: the bus, where in the frames the counts are, and what motion is possible."""

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.wheel_signals import InfoSignals, MessageSettings, NodeAddresses, WheelSignals

INFANT_LEFT = WheelSignals(
    message="WHEEL_L_FB",
    count="L_Count",
    speed="L_Speed",
    status="L_Status",
    alive="L_Alive",
    boot_id="L_BootId",
    crc="L_Crc",
    info=InfoSignals(
        message="WHEEL_L_INFO",
        counts_per_rev="L_CountsPerRev",
        period_ms="L_PeriodMs",
        schema_version="L_SchemaVersion",
        uptime_ms="L_UptimeMs",
    ),
)
INFANT_RIGHT = WheelSignals(
    message="WHEEL_R_FB",
    count="R_Count",
    speed="R_Speed",
    status="R_Status",
    alive="R_Alive",
    boot_id="R_BootId",
    crc="R_Crc",
    info=InfoSignals(
        message="WHEEL_R_INFO",
        counts_per_rev="R_CountsPerRev",
        period_ms="R_PeriodMs",
        schema_version="R_SchemaVersion",
        uptime_ms="R_UptimeMs",
    ),
)


class BusSettings(BaseModel):
    """One CAN bus as python-can knows it; any interface that python-can has can be named."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    interface: str = Field(
        default="udp_multicast",
        pattern=r"^[a-z0-9_]+$",
        description="python-can interface: socketcan, slcan, pcan, kvaser, gs_usb, virtual, udp_multicast, ...",
    )
    channel: str = Field(
        default="239.74.163.2",
        min_length=1,
        description="can0, a serial device, or the multicast group; the default is python-can's own IPv4 group",
    )
    bitrate: int = Field(
        default=500_000,
        ge=10_000,
        le=1_000_000,
        description="bit/s; given to adapters that take it, named in advice otherwise",
    )
    port: int = Field(
        default=0,
        ge=0,
        le=65_535,
        description="UDP port of udp_multicast; 0: the simulated node picks one that is free",
    )
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict, description="further keyword arguments of that python-can interface"
    )
    silence_s: float = Field(
        default=0.5,
        ge=0.1,
        le=30.0,
        description="seconds without any frame after which the bus is opened again",
    )
    backoff_min_s: float = Field(
        default=0.1, ge=0.01, le=5.0, description="seconds before the first new attempt to open"
    )
    backoff_max_s: float = Field(
        default=0.5,
        ge=0.05,
        le=60.0,
        description="longest wait between attempts; a bus that is back must be used within 1 s",
    )
    receive_buffer_bytes: int = Field(
        default=8_388_608,
        ge=4096,
        le=67_108_864,
        description="asked of the kernel: a second of 20 000 frames",
    )


class DbcLayout(BaseModel):
    """Frames described by a DBC file; the default is the rover's own."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["dbc"] = "dbc"
    file: str = Field(
        default="config/infant.dbc", description="path; a relative one is sought here, then in the sources"
    )
    left: WheelSignals = INFANT_LEFT
    right: WheelSignals = INFANT_RIGHT


class SignalsLayout(BaseModel):
    """Frames described here, without a file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["signals"] = "signals"
    messages: tuple[MessageSettings, ...] = Field(min_length=1, description="every message that is named below")
    left: WheelSignals
    right: WheelSignals


class PresetLayout(NodeAddresses):
    """Frames of a common motor controller; wheel_presets.py writes the signals down."""

    kind: Literal["preset"]
    name: Literal["odrive", "odrive_counts", "vesc", "cia402"] = Field(description="which controller")


class Cia406Layout(NodeAddresses):
    """CANopen encoders after CiA 406: process data as mapped in the device's EDS, heartbeat, emergency."""

    kind: Literal["cia406"]
    file: str = Field(default="config/encoder406.eds", description="EDS of the encoder; same rule as for a DBC")
    tpdo: int = Field(default=1, ge=1, le=4, description="which process data object carries 6004h")
    start_nodes: bool = Field(default=True, description="send NMT start when the bus opens and after a boot-up message")


Layout = Annotated[DbcLayout | SignalsLayout | PresetLayout | Cia406Layout, Field(discriminator="kind")]


class WheelSettings(BaseModel):
    """One wheel's counter."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sign: Literal[1, -1] = Field(default=1, description="-1 where the counter falls while the rover drives forward")
    modulus: int = Field(
        default=0,
        ge=0,
        le=2**63,
        description="the counter wraps here (65536, 9000, object 6002h); 0: as wide as its signal",
    )


class EncoderSettings(BaseModel):
    """The table [encoders] of the configuration."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    bus: BusSettings = Field(default_factory=BusSettings)
    layout: Layout = Field(default_factory=DbcLayout)
    left: WheelSettings = Field(default_factory=WheelSettings)
    right: WheelSettings = Field(default_factory=WheelSettings)
    counts_per_rev: float = Field(
        default=4096.0,
        gt=0.0,
        le=1e9,
        description="counts per turn of the wheel; 1024 lines x 4 on the rover",
    )
    wheel_radius_m: float = Field(
        default=0.125, gt=0.001, le=5.0, description="nominal; only to judge what motion is possible"
    )
    max_speed_mps: float = Field(
        default=1.944,
        gt=0.01,
        le=100.0,
        description="top speed of a wheel; 7 km/h (paper, Table II); 1.5 times this is a jump",
    )
    period_ms: float = Field(default=20.0, ge=1.0, le=1000.0, description="time between two frames of one wheel")
    degraded_periods: float = Field(
        default=3.0, ge=1.5, le=100.0, description="silence after which a wheel is degraded"
    )
    silent_periods: float = Field(
        default=10.0, ge=2.0, le=1000.0, description="silence after which the samples are invalid"
    )
    speed_tolerance_m: float = Field(
        default=0.008,
        ge=0.0,
        le=10.0,
        description="counts and speed signal may drift apart by this over half a second, below 1 cm so that a stuck "
        "counter never turns the rover; 0: not compared, for devices that filter their speed",
    )
    stuck_travel_m: float = Field(
        default=0.5,
        ge=0.05,
        le=100.0,
        description="travel of one wheel during which the other stands still that is reported",
    )

    @property
    def counts_per_metre(self) -> float:
        """Counts for one metre rolled."""
        return self.counts_per_rev / (2.0 * math.pi * self.wheel_radius_m)

    @property
    def period_ns(self) -> int:
        """Time between two frames of one wheel."""
        return round(self.period_ms * 1e6)

    @model_validator(mode="after")
    def _silence_follows_degradation(self) -> Self:
        if self.silent_periods <= self.degraded_periods:
            raise ValueError(
                f"silent_periods above degraded_periods ({self.degraded_periods:g}), not {self.silent_periods:g}"
            )
        return self
