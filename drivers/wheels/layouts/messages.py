"""One wheel's messages in both directions: cantools does the bits, this file knows which signal means what."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cantools.database.can import Message
from crccheck.crc import Crc

from drivers.canbus.frame import EXTENDED, CanFrame
from drivers.measurements import DriverError
from drivers.settings.wheel_signals import InfoSignals, WheelSignals
from drivers.wheels.readings import Decoded, NodeInfo, Refused, Wheel, WheelReading


@dataclass(frozen=True, slots=True)
class Quantity:
    """Signal name with the factor and the offset from raw value to the wanted unit."""

    name: str
    factor: float
    offset: float = 0.0

    def value(self, raw: float) -> float:
        """The raw value in the wanted unit; an int stays one where the factor is 1."""
        return raw if self.factor == 1.0 and self.offset == 0.0 else raw * self.factor + self.offset


def quantity(message: Message, name: str, unit_factor: float) -> Quantity:
    """The signal's own scale times a factor. Raises DriverError for a name that the message does not have."""
    signal = signal_of(message, name)
    conversion = signal.conversion
    scale, offset = float(getattr(conversion, "scale", 1.0)), float(getattr(conversion, "offset", 0.0))
    return Quantity(name, scale * unit_factor, offset * unit_factor)


def signal_of(message: Message, name: str):  # type: ignore[no-untyped-def]  # cantools exports no type for it
    """The signal, or a sentence with the names that there are."""
    for signal in message.signals:
        if signal.name == name:
            if signal.multiplexer_ids:
                raise DriverError(f"signal {name} of message {message.name} is multiplexed; name one that is not")
            return signal
    known = ", ".join(signal.name for signal in message.signals)
    raise DriverError(f"signal {name}: message {message.name} has only {known}; correct the name in the layout")


class FeedbackMessage:
    """The fast message of one wheel.

    speed_factor: counts per second in one unit of the scaled speed signal.
    """

    def __init__(self, wheel: Wheel, message: Message, signals: WheelSignals, speed_factor: float) -> None:
        self.wheel = wheel
        self.arbitration_id = signals.frame_id if signals.frame_id >= 0 else message.frame_id
        self._message = message
        self._signals = signals
        self._count = quantity(message, signals.count, signals.counts_per_unit) if signals.count else None
        self._speed = quantity(message, signals.speed, speed_factor) if signals.speed else None
        self._status_ok = frozenset(signals.status_ok)
        for name in (signals.status, signals.alive, signals.boot_id):
            if name:
                signal_of(message, name)
        self._crc_byte = self._byte_of_crc() if signals.crc else -1
        self._crc = Crc(8, signals.crc_polynomial, signals.crc_init, xor_output=signals.crc_xor_out)
        id_bytes = self.arbitration_id.to_bytes(4, "little")[:2]
        self._crc_prefix = id_bytes if signals.crc_over_id else b""

    @property
    def modulus(self) -> float:
        """Counts after which a position as wide as its signal wraps; 0: floating point, never."""
        if self._count is None:
            return 0.0
        signal = signal_of(self._message, self._count.name)
        if signal.conversion.is_float:
            return 0.0
        span: float = 2**signal.length
        return span if self._count.factor == 1.0 else span * abs(self._count.factor)

    @property
    def counts_per_bit(self) -> float:
        """Counts in one raw unit of the position."""
        return self._count.factor if self._count is not None else 1.0

    @property
    def alive_modulus(self) -> int:
        """Values of the rolling counter; 0: none is sent."""
        return 2 ** int(signal_of(self._message, self._signals.alive).length) if self._signals.alive else 0

    def decode(self, data: bytes) -> tuple[Decoded, ...]:
        """The reading, or the refusal of a frame whose checksum does not fit."""
        if self._crc_byte >= 0 and self.checksum(data) != data[self._crc_byte]:
            return (Refused(self.wheel, "crc"),)
        values: dict[str, Any] = self._message.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
        signals = self._signals
        status = values[signals.status] & signals.status_mask if signals.status else 0
        return (
            WheelReading(
                self.wheel,
                self._count.value(values[self._count.name]) if self._count is not None else None,
                self._speed.value(values[self._speed.name]) if self._speed is not None else None,
                status,
                not signals.status or status in self._status_ok,
                values[signals.alive] if signals.alive else None,
                values[signals.boot_id] if signals.boot_id else None,
            ),
        )

    def encode(self, values: Mapping[str, float], stamp_ns: int = 0) -> CanFrame:
        """A frame with these raw signal values, absent ones 0, and its checksum."""
        raw = {signal.name: values.get(signal.name, 0) for signal in self._message.signals}
        data = bytearray(self._message.encode(raw, scaling=False, strict=False))
        if self._crc_byte >= 0:
            data[self._crc_byte] = self.checksum(data)
        flags = EXTENDED if self._message.is_extended_frame else 0
        return CanFrame(stamp_ns, self.arbitration_id, bytes(data), flags)

    def checksum(self, data: bytes | bytearray) -> int:
        """CRC-8 over the id, where the layout says so, and all bytes but its own."""
        place = self._crc_byte
        return int(self._crc.calc(self._crc_prefix + data[:place] + data[place + 1 :]))

    def _byte_of_crc(self) -> int:
        signal = signal_of(self._message, self._signals.crc)
        start = signal.start if signal.byte_order == "little_endian" else signal.start - 7
        if signal.length != 8 or start % 8:
            raise DriverError(
                f"signal {signal.name}: a checksum must be one whole byte, not {signal.length} bits from bit "
                f"{signal.start}; name another signal in crc"
            )
        return int(start // 8)


class InfoMessage:
    """The slow message of one wheel's node."""

    def __init__(self, wheel: Wheel, message: Message, signals: InfoSignals) -> None:
        self.wheel = wheel
        self.arbitration_id = int(message.frame_id)
        self._message = message
        self._names = (signals.counts_per_rev, signals.period_ms, signals.schema_version, signals.uptime_ms)
        for name in self._names:
            if name:
                signal_of(message, name)

    def decode(self, data: bytes) -> tuple[Decoded, ...]:
        """What the node says of itself."""
        values: dict[str, Any] = self._message.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
        return (NodeInfo(self.wheel, *(values[name] if name else None for name in self._names)),)

    def encode(self, info: NodeInfo, stamp_ns: int = 0) -> CanFrame:
        """The frame that says this."""
        raw = dict.fromkeys((signal.name for signal in self._message.signals), 0)
        for name, value in zip(self._names, info[1:], strict=True):
            if name:
                raw[name] = value or 0
        flags = EXTENDED if self._message.is_extended_frame else 0
        return CanFrame(stamp_ns, self.arbitration_id, self._message.encode(raw, scaling=False, strict=False), flags)
