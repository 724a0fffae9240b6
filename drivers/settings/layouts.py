"""[encoders.layout]: how the counts of a wheel lie in CAN frames."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

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
    """Frames described by a DBC file; the default is that of Infant's own nodes.

    For other frames, name a DBC and its signals.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["dbc"] = "dbc"
    file: str | None = Field(
        default=None,
        min_length=1,
        description="Path of the DBC, relative to the configuration, else in the config/ folder of the program; "
        "absent: Infant's own. Ask the maker of the wheels for it",
    )
    left: WheelSignals = INFANT_LEFT
    right: WheelSignals = INFANT_RIGHT

    @model_validator(mode="after")
    def _rovers_own_have_their_info(self) -> Self:
        """No file names the slow message: it comes with the signals of the rover's own nodes."""
        for side, own in (("left", INFANT_LEFT), ("right", INFANT_RIGHT)):
            if getattr(self, side) == own.model_copy(update={"info": None}):
                object.__setattr__(self, side, own)
        return self


class SignalsLayout(BaseModel):
    """Frames described in the program: what a preset or an EDS becomes. No choice of the configuration."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    messages: tuple[MessageSettings, ...] = Field(min_length=1, description="every message that is named below")
    left: WheelSignals
    right: WheelSignals


class PresetLayout(NodeAddresses):
    """Frames of a common motor controller."""

    kind: Literal["preset"]
    name: Literal["odrive", "odrive_counts", "vesc", "cia402"] = Field(
        description="Which controller, by its maker's name; odrive_counts if its encoder_count_rate_ms is set. "
        "`infant setup` recognises it"
    )


class Cia406Layout(NodeAddresses):
    """CANopen encoders according to CiA 406: process data as mapped in the device's EDS, heartbeat, emergency."""

    kind: Literal["cia406"]
    file: str | None = Field(
        default=None,
        min_length=1,
        description="EDS of the encoder, from its maker; the path works like that of a DBC. Absent: a plain "
        "encoder of that profile",
    )
    tpdo: int = Field(
        default=1,
        ge=1,
        le=4,
        description="Number of the process data object that carries the position (6004h). The EDS says it; `infant "
        "check` reports a wrong one",
    )


Layout = Annotated[DbcLayout | PresetLayout | Cia406Layout, Field(discriminator="kind")]
