"""CANopen encoders after CiA 406, decoded from the process data mapping in their EDS.

The decoder reads frames like any other layout, so that one reader thread supervises every kind of wheel;
canopen is used for the object dictionary only.
"""

import os
import re
from io import StringIO
from pathlib import Path
from typing import Any

from cantools.database.can import Message

from drivers.canbus.frame import CanFrame
from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout
from drivers.settings.wheel_signals import MessageSettings, SignalSettings, WheelSignals
from drivers.wheels.layouts.dbc_file import decoded
from drivers.wheels.layouts.routes import built_message, decoder_of
from drivers.wheels.readings import Decoded, Decoder, NodeAlarm, NodeState, Route, Wheel, WheelDecoder

POSITION, TOTAL_RANGE = 0x6004, 0x6002
HEARTBEAT, EMERGENCY = 0x700, 0x080
ENCODER_EDS = Path(__file__).with_name("encoder406.eds")
MOST_BITS = 64  # a frame
LARGEST_BYTES = 1 << 22  # 4 MB; an EDS has some 100 kB
MOST_LINES = 100_000
ENDLESS = re.compile(rb"(?:NrOfEntries|Lines)\s*[=:]\s*\+?[\d_]{7}", re.IGNORECASE)  # canopen would count so far
START_NODES = True  # NMT start when the bus opens and after a boot-up message; harmless beside another master
NMT_START = 0x01
SIGNED_TYPES = (0x02, 0x03, 0x04, 0x15)  # CiA 301 data types INTEGER8, 16, 32, 64


def cia406_decoder(layout: Cia406Layout, settings: EncoderSettings) -> WheelDecoder:
    """Routes for process data, heartbeat and emergency of both nodes.

    Raises DriverError where canopen is missing or the EDS does not map a position.
    """
    nodes = {Wheel.LEFT: layout.left_node, Wheel.RIGHT: layout.right_node}
    path = ENCODER_EDS if layout.file is None else Path(layout.file)
    total_range = _default(read_eds(path, layout.right_node), TOTAL_RANGE, 0)
    frames = decoder_of(*cia406_messages(layout), settings)
    routes = dict(frames.routes)
    for wheel, node in nodes.items():
        routes[HEARTBEAT + node] = Route((wheel,), False, 1, _heartbeat(wheel))
        routes[EMERGENCY + node] = Route((wheel,), False, 8, _emergency(wheel))
    chosen = {Wheel.LEFT: settings.left.modulus, Wheel.RIGHT: settings.right.modulus}
    modulus = {wheel: chosen[wheel] or total_range or frames.modulus[wheel] for wheel in nodes}
    start = tuple(CanFrame(0, 0, bytes((NMT_START, node))) for node in nodes.values() if START_NODES)
    return WheelDecoder(routes, modulus, frames.alive_modulus, True, start)


def cia406_messages(layout: Cia406Layout) -> tuple[dict[str, Message], WheelSignals, WheelSignals]:
    """The process data of both nodes as messages, and what the left and the right wheel read of them."""
    nodes = {Wheel.LEFT: layout.left_node, Wheel.RIGHT: layout.right_node}
    path = ENCODER_EDS if layout.file is None else Path(layout.file)
    messages = {
        wheel.value: built_message(mapped_message(read_eds(path, node), layout.tpdo, wheel, path))
        for wheel, node in nodes.items()
    }
    left, right = (WheelSignals(message=wheel.value, count="position") for wheel in nodes)
    return messages, left, right


def read_eds(path: Path, node: int) -> Any:
    """canopen's object dictionary of the file for this node number."""
    try:
        import canopen
    except ImportError as error:
        raise DriverError(
            "layout.kind = 'cia406' needs the package canopen; install it with: pip install 'infant[canopen]'"
        ) from error
    if not path.is_file():
        raise DriverError(f"{path}: no such file; give the path of the encoder's EDS in layout.file")
    if path.stat().st_size > LARGEST_BYTES:
        raise DriverError(f"{path}: has more than {LARGEST_BYTES >> 20} MB; give the path of an EDS in layout.file")
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as stream:  # a pipe would not end
        content = stream.read(LARGEST_BYTES) or b""
    if len(content.splitlines()) > MOST_LINES:
        raise DriverError(f"{path}: has more than {MOST_LINES} lines; give the path of an EDS in layout.file")
    if ENDLESS.search(content):
        raise DriverError(
            f"{path}: counts millions of entries, more than any device has; correct the file or name another"
        )
    try:
        return canopen.import_od(_NamedText(content, path), node)
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise DriverError(f"{path}: not a usable EDS ({reason}); correct the file or name another") from error


class _NamedText(StringIO):
    """The text of a file as canopen takes it, in whatever encoding it was saved: what counts in it is ASCII."""

    def __init__(self, content: bytes, path: Path) -> None:
        super().__init__(decoded(content))
        self.name = str(path)


def mapped_message(dictionary: Any, tpdo: int, wheel: Wheel, path: Path) -> MessageSettings:
    """The process data object as a message: COB-ID of 18xxh and mapping entries of 1Axxh (index, sub, bits)."""
    try:
        identifier = int(dictionary[0x1800 + tpdo - 1][1].default)
        mapping = dictionary[0x1A00 + tpdo - 1]
        entries = [int(mapping[place].default) for place in range(1, int(mapping[0].default) + 1)]
        signals = _signals(dictionary, entries)
    except Exception as error:
        raise DriverError(
            f"{path}: has no TPDO{tpdo} with a usable default mapping; set layout.tpdo to one that it has"
        ) from error
    if not any(signal.name == "position" for signal in signals):
        raise DriverError(f"{path}: TPDO{tpdo} does not map the position 6004h; set layout.tpdo to the one that does")
    length = (sum(signal.length for signal in signals) + 7) // 8
    return MessageSettings(name=wheel.value, frame_id=identifier & 0x7FF, length=length, signals=tuple(signals))


def _signals(dictionary: Any, entries: list[int]) -> list[SignalSettings]:
    """What the entries of a mapping (index, sub, bits) put into a message of at most 8 bytes, in order."""
    signals, bit = [], 0
    for place, entry in enumerate(entries, start=1):
        index, bits = entry >> 16, entry & 0xFF
        signed = _data_type(dictionary, index, entry >> 8 & 0xFF) in SIGNED_TYPES
        name = "position" if index == POSITION else f"object_{index:04X}_{place}"
        signals.append(SignalSettings(name=name, start=bit, length=bits, type="signed" if signed else "unsigned"))
        bit += bits
    if bit > MOST_BITS:
        raise ValueError(f"{bit} bits are mapped")
    return signals


def _heartbeat(wheel: Wheel) -> Decoder:
    def decode(data: bytes) -> tuple[Decoded, ...]:
        return (NodeState(wheel, data[0] & 0x7F),)

    return decode


def _emergency(wheel: Wheel) -> Decoder:
    def decode(data: bytes) -> tuple[Decoded, ...]:
        return (NodeAlarm(wheel, int.from_bytes(data[:2], "little")),)

    return decode


def _default(dictionary: Any, index: int, absent: int) -> int:
    try:
        return int(dictionary[index].default)
    except (KeyError, TypeError, ValueError, AttributeError):
        return absent


def _data_type(dictionary: Any, index: int, sub: int) -> int:
    entry = dictionary[index]
    return int(entry[sub].data_type if hasattr(entry, "subindices") else entry.data_type)
