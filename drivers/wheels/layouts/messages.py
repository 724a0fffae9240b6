"""One wheel's messages in both directions: cantools does the bits, this file knows which signal means what."""

import math
from collections.abc import Mapping
from typing import Any

from cantools.database.can import Message
from crccheck.crc import Crc

from drivers.canbus.frame import EXTENDED, CanFrame
from drivers.measurements import DriverError
from drivers.settings.wheel_signals import InfoSignals, WheelSignals
from drivers.wheels.layouts.direction import DirectionSignal, is_own_direction
from drivers.wheels.layouts.signals import clipped, quantity, raw_limits, sentinels, signal_of, wrapped
from drivers.wheels.readings import Decoded, NodeInfo, Refused, Wheel, WheelReading


class FeedbackMessage:
    """The fast message of one wheel.

    speed_factor: counts per second in one unit of the scaled speed signal. Of a multiplexed message, frames that do
    not hold this wheel's count say nothing of it.
    """

    def __init__(self, wheel: Wheel, message: Message, signals: WheelSignals, speed_factor: float) -> None:
        self.wheel = wheel
        self.arbitration_id = signals.frame_id if signals.frame_id >= 0 else message.frame_id
        self._message = message
        self._signals = signals
        self._count = quantity(message, signals.count, signals.counts_per_unit) if signals.count else None
        self._speed = quantity(message, signals.speed, speed_factor) if signals.speed else None
        self._status_ok = frozenset(signals.status_ok)
        self._direction = DirectionSignal(message, signals) if is_own_direction(signals) else None
        for name in (signals.status, signals.alive, signals.boot_id):
            if name:
                signal_of(message, name)
        measured = [each.name for each in (self._count, self._speed) if each is not None]
        self._limits = {name: limits for name in measured if (limits := raw_limits(signal_of(message, name)))}
        self._sentinels = {name: sentinels(signal_of(message, name)) for name in measured}
        self._crc_byte = self._byte_of_crc() if signals.crc else -1
        # the library takes 4 us for a frame, a table of its own results for one byte 1 us
        one_byte = Crc(8, signals.crc_polynomial, 0)
        self._crc_table = bytes(one_byte.calc(bytes((byte,))) for byte in range(256))
        self._crc_xor_out = signals.crc_xor_out
        id_bytes = self.arbitration_id.to_bytes(4, "little")[:2] if signals.crc_over_id else b""
        self._crc_begin = self._crc_of(id_bytes, signals.crc_init)

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
        name = self._signals.alive
        if not name or self._is_shared(name):
            return 0
        return 1 << int(signal_of(self._message, name).length)

    @property
    def is_signed(self) -> bool:
        """Whether the way back is told from the way forth: by a sign, a count that falls, or a direction."""
        if self._signals.direction or self._count is not None:
            return True
        signal = signal_of(self._message, self._signals.speed)
        return bool(signal.is_signed or signal.conversion.is_float or self._speed is None or self._speed.offset < 0.0)

    @property
    def crc_byte(self) -> int:
        """Place of the checksum; -1: none is sent."""
        return self._crc_byte

    def shares_frame_with(self, other: "FeedbackMessage") -> bool:
        """Whether one frame carries both wheels; those of a multiplexed message come in turn."""
        measured = signal_of(self._message, self._signals.count or self._signals.speed)
        return self.arbitration_id == other.arbitration_id and not measured.multiplexer_ids

    def _is_shared(self, name: str) -> bool:
        """Whether frames of the other wheel have this signal too, which a multiplexer tells from this wheel's."""
        measured = self._signals.count or self._signals.speed
        own = signal_of(self._message, measured).multiplexer_ids
        return bool(own) and signal_of(self._message, name).multiplexer_ids != own

    def decode(self, data: bytes) -> tuple[Decoded, ...]:
        """The reading, or the refusal of a frame whose checksum does not fit."""
        if self._crc_byte >= 0 and self.checksum(data) != data[self._crc_byte]:
            return (Refused(self.wheel, "crc"),)
        values: dict[str, Any] = self._message.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
        signals = self._signals
        measured = [each.name for each in (self._count, self._speed) if each is not None]
        if measured[0] not in values:
            return ()
        if not all(math.isfinite(values[name]) for name in measured if name in values):
            return (Refused(self.wheel, "not_finite"),)
        for name, (low, high) in self._limits.items():
            if name in values and not low <= values[name] <= high:
                return (Refused(self.wheel, "out_of_range"),)
        if signals.speed in values and values[signals.speed] in self._sentinels[signals.speed]:
            return (Refused(self.wheel, "not_available"),)
        status = int(values.get(signals.status, 0)) & signals.status_mask if signals.status else 0
        speed = self._speed
        return (
            WheelReading(
                self.wheel,
                self._count.value(values[self._count.name]) if self._count is not None else None,
                speed.value(values[speed.name]) if speed is not None and speed.name in values else None,
                status,
                signals.status not in values or status in self._status_ok,
                values.get(signals.alive),
                values.get(signals.boot_id),
                self._direction.of(values) if self._direction is not None else 1,
                self._count is not None and values[self._count.name] in self._sentinels[self._count.name],
            ),
        )

    def motion(self, count: float, counts_per_s: float) -> dict[str, float]:
        """Raw values that say this of the wheel, as far as its signals can: what `decode` reads, the other way."""
        raw: dict[str, float] = {}
        measured = signal_of(self._message, self._signals.count or self._signals.speed)
        if measured.multiplexer_ids:
            raw[str(measured.multiplexer_signal)] = measured.multiplexer_ids[0]
        if self._count is not None:
            raw[self._count.name] = wrapped(signal_of(self._message, self._count.name), self._count.raw(count))
        if self._speed is not None:
            signal = signal_of(self._message, self._speed.name)
            said = abs(counts_per_s) if self._direction is not None and not signal.is_signed else counts_per_s
            raw[self._speed.name] = clipped(signal, self._speed.raw(said))
        if self._direction is not None:
            raw[self._direction.name] = self._direction.raw(counts_per_s < 0.0)
        return raw

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
        return self._crc_of(data[:place] + data[place + 1 :], self._crc_begin) ^ self._crc_xor_out

    def _crc_of(self, data: bytes | bytearray, remainder: int) -> int:
        table = self._crc_table
        for byte in data:
            remainder = table[remainder ^ byte]
        return remainder

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
