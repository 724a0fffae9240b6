"""[encoders.layout]: how the counts of a wheel lie in CAN frames."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.settings.wheel_signals import InfoSignals, MessageSettings, NodeAddresses, WheelSignals

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
