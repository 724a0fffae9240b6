"""Names and places of signals in CAN frames, as configuration writes them."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

SpeedUnit = Literal["counts_per_period", "motor_turns_per_s", "counts_per_s", "turns_per_s", "rpm", "mps", "kph"]


class InfoSignals(BaseModel):
    """The slow message in which a node says what it is."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    message: str = Field(description="message name")
    counts_per_rev: str = Field(default="", description="signal; empty: absent")
    period_ms: str = Field(default="", description="signal; empty: absent")
    schema_version: str = Field(default="", description="signal; empty: absent")
    uptime_ms: str = Field(default="", description="signal; empty: absent. Falls when the node has restarted")


class WheelSignals(BaseModel):
    """Where the motion of one wheel is found. An empty name is a signal that the device does not send."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    message: str = Field(
        description="Name of the message that carries this wheel, as the DBC has it",
    )
    frame_id: int = Field(
        default=-1, ge=-1, le=0x1FFFFFFF, description="in place of the message's own id; -1: keeps it"
    )
    count: str = Field(
        default="",
        description="Signal of the cumulative position, as the DBC names it; empty for a device that sends only "
        "its speed",
    )
    counts_per_unit: float = Field(
        default=1.0,
        ge=1e-6,
        le=1e12,
        description="Counts in one unit of the scaled position. Change it if the DBC scales to turns or metres. For "
        "a speed in m/s or km/h, counts in a metre: enter counts_per_rev / (2 pi radius of the drawing) and leave "
        "it there, and the radius that `infant calibrate` finds scales the speed; at 1 its scale stays as sent",
    )
    speed: str = Field(
        default="",
        description="Signal of the speed, as the DBC names it. It is integrated if there is no position, and "
        "compared with the position otherwise",
    )
    speed_unit: SpeedUnit = Field(
        default="counts_per_period",
        description="Unit of the scaled speed. Take the unit that the scale of the DBC gives",
    )
    direction: str = Field(
        default="",
        description="Signal that says which way the wheel turns, if speed or count have no sign: SIGNAL of the "
        "same message, or MESSAGE.SIGNAL of another, such as the gear. Without it, backwards counts as "
        "forwards for such wheels",
    )
    direction_reverse: tuple[int, ...] = Field(
        default=(1,), description="Values of the direction that mean backwards. The DBC or the manual lists them"
    )
    status: str = Field(
        default="",
        description="Signal of the node's state, as the DBC names it; empty if the device sends none",
    )
    status_mask: int = Field(default=0xFFFFFFFF, ge=0, le=0xFFFFFFFF, description="bits of the state that matter")
    status_ok: tuple[int, ...] = Field(
        default=(0,), description="Values of the state with which the counts are valid. The device's manual lists them"
    )
    alive: str = Field(
        default="",
        description="Signal of the rolling counter that shows lost frames, as the DBC names it; it wraps at the "
        "width of the signal",
    )
    boot_id: str = Field(
        default="",
        description="Signal that changes with every power-up, as the DBC names it, so that a counter that restarts "
        "is not taken for a jump",
    )
    crc: str = Field(
        default="",
        description="Signal of the CRC-8 (SAE J1850 over id and data), one whole byte, as the DBC names it; empty "
        "if the device sends none",
    )
    crc_polynomial: int = Field(default=0x1D, ge=1, le=255, description="SAE J1850")
    crc_init: int = Field(default=0xFF, ge=0, le=255, description="SAE J1850")
    crc_xor_out: int = Field(default=0xFF, ge=0, le=255, description="SAE J1850")
    crc_over_id: bool = Field(default=True, description="the two id bytes, low first, go in before the data")
    info: InfoSignals | None = Field(default=None, description="slow message of the node; absent where it sends none")

    @model_validator(mode="after")
    def _measures_something(self) -> Self:
        if not self.count and not self.speed:
            raise ValueError(f"a signal name in count or speed for message {self.message}")
        return self

    @property
    def tells_metres(self) -> bool:
        """Whether all that it sends is a speed into which the node has put a wheel radius."""
        return not self.count and self.speed_unit in ("mps", "kph")

    @property
    def is_scaled_by_radius(self) -> bool:
        """Whether a radius that is calibrated changes what the speed means; it cancels where nobody says its counts."""
        return not self.tells_metres or self.counts_per_unit != 1.0


class SignalSettings(BaseModel):
    """One signal of a message, with the bit numbering of a DBC."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, description="as used in left and right")
    start: int = Field(ge=0, le=511, description="start bit as in a DBC: lowest if little, highest if big endian")
    length: int = Field(ge=1, le=64, description="bits")
    order: Literal["little", "big"] = Field(default="little", description="byte order")
    type: Literal["unsigned", "signed", "float"] = Field(default="unsigned", description="how the bits are read")
    scale: float = Field(default=1.0, allow_inf_nan=False, description="units per bit")
    offset: float = Field(default=0.0, allow_inf_nan=False, description="units at the raw value 0")


class MessageSettings(BaseModel):
    """One message: id, length and signals."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, description="as used in left and right")
    frame_id: int = Field(ge=0, le=0x1FFFFFFF, description="arbitration id")
    extended: bool = Field(default=False, description="29-bit id")
    length: int = Field(default=8, ge=1, le=64, description="bytes; frames of another length are refused")
    signals: tuple[SignalSettings, ...] = Field(min_length=1, description="what it carries")


class NodeAddresses(BaseModel):
    """The two nodes of a layout that is addressed by node number."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    left_node: int = Field(
        ge=0,
        le=255,
        description="Node number of the left wheel. The setup tool of the controller shows it, and `infant setup` "
        "hears it",
    )
    right_node: int = Field(ge=0, le=255, description="Node number of the right wheel, found in the same way")

    @model_validator(mode="after")
    def _nodes_differ(self) -> Self:
        if self.left_node == self.right_node:
            raise ValueError(f"two different node numbers, not {self.left_node} for both wheels")
        return self
