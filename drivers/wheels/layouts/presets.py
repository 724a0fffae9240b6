"""Layouts of common motor controllers: nothing but configuration, written down once.

Sources: ODrive docs/can-protocol.rst (CAN Simple, firmware 0.5), vedderb/bldc documentation/comm_can.md,
CiA 402 (objects 6041h and 6064h, mapped into TPDO1 in this order).
"""

from drivers.settings.layouts import PresetLayout, SignalsLayout
from drivers.settings.wheel_signals import MessageSettings, SignalSettings, WheelSignals

COUNTS_PER_MOTOR_TURN = 4096.0  # ODrive sends turns; counts_per_rev is this times motor turns per wheel turn


def preset_layout(preset: PresetLayout) -> SignalsLayout:
    """The signals of a preset for its two nodes."""
    message, wheel = PRESETS[preset.name]
    sides = {"LEFT": preset.left_node, "RIGHT": preset.right_node}
    return SignalsLayout(
        messages=tuple(
            message.model_copy(update={"name": side, "frame_id": frame_id(preset.name, node)})
            for side, node in sides.items()
        ),
        left=wheel.model_copy(update={"message": "LEFT"}),
        right=wheel.model_copy(update={"message": "RIGHT"}),
    )


def frame_id(name: str, node: int) -> int:
    """Arbitration id under which a node of this preset sends its position."""
    match name:
        case "odrive":
            return node << 5 | 0x09  # Get_Encoder_Estimates
        case "odrive_counts":
            return node << 5 | 0x0A  # Get_Encoder_Count, off unless encoder_count_rate_ms is set
        case "vesc":
            return 27 << 8 | node  # CAN_PACKET_STATUS_5
        case _:
            return 0x180 + node  # CANopen TPDO1


def _message(*signals: SignalSettings, extended: bool = False, length: int = 8) -> MessageSettings:
    return MessageSettings(name="-", frame_id=0, extended=extended, length=length, signals=signals)


PRESETS: dict[str, tuple[MessageSettings, WheelSignals]] = {
    "odrive": (
        _message(
            SignalSettings(name="position_turns", start=0, length=32, type="float"),
            SignalSettings(name="velocity_turns_per_s", start=32, length=32, type="float"),
        ),
        WheelSignals(
            message="-",
            count="position_turns",
            counts_per_unit=COUNTS_PER_MOTOR_TURN,
            speed="velocity_turns_per_s",
            speed_unit="motor_turns_per_s",
        ),
    ),
    "odrive_counts": (
        _message(
            SignalSettings(name="shadow_count", start=0, length=32, type="signed"),
            SignalSettings(name="count_in_turn", start=32, length=32, type="signed"),
        ),
        WheelSignals(message="-", count="shadow_count"),
    ),
    "vesc": (
        _message(
            SignalSettings(name="tachometer", start=7, length=32, order="big", type="signed"),
            SignalSettings(name="input_voltage_v", start=39, length=16, order="big", type="signed", scale=0.1),
            extended=True,
        ),
        WheelSignals(message="-", count="tachometer"),
    ),
    "cia402": (
        _message(
            SignalSettings(name="statusword", start=0, length=16),
            SignalSettings(name="position", start=16, length=32, type="signed"),
            length=6,
        ),
        WheelSignals(message="-", count="position", status="statusword", status_mask=0x08, status_ok=(0,)),
    ),
}
