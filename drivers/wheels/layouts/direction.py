"""Which way a wheel turns, where its speed or count has no sign: a signal of its own message, or of another."""

from collections.abc import Mapping
from typing import Any

from cantools.database.can import Message

from drivers.canbus.frame import EXTENDED, CanFrame
from drivers.settings.wheel_signals import WheelSignals
from drivers.wheels.layouts.signals import signal_of
from drivers.wheels.readings import Decoded, Gear, Wheel


class DirectionSignal:
    """Which way the wheels turn, where their message does not say it by a sign: a bit, or the gear."""

    def __init__(self, message: Message, signals: WheelSignals) -> None:
        self.name = signals.direction.rpartition(".")[2]
        self._reverse = frozenset(signals.direction_reverse)
        signal = signal_of(message, self.name)
        self._unknown = frozenset({2**signal.length - 1} if signal.length > 1 else ())  # SAE J1939: two bits, 11

    def raw(self, backward: bool) -> int:
        """A value that says this."""
        return (
            min(self._reverse) if backward else next(k for k in range(len(self._reverse) + 1) if k not in self._reverse)
        )

    def of(self, values: Mapping[str, Any]) -> int:
        """1 forward, -1 backward, 0 where these signals do not say."""
        value = values.get(self.name)
        if value is None or (value in self._unknown and value not in self._reverse):
            return 0
        return -1 if value in self._reverse else 1


class DirectionMessage:
    """Another message that says which way a wheel turns, such as that of the gear."""

    def __init__(self, wheel: Wheel, message: Message, signals: WheelSignals) -> None:
        self.wheel = wheel
        self.arbitration_id = int(message.frame_id)
        self._message = message
        self._signal = DirectionSignal(message, signals)

    def encode(self, backward: bool, stamp_ns: int = 0) -> CanFrame:
        """The frame that says this."""
        raw = dict.fromkeys((signal.name for signal in self._message.signals), 0) | {
            self._signal.name: self._signal.raw(backward)
        }
        flags = EXTENDED if self._message.is_extended_frame else 0
        return CanFrame(stamp_ns, self.arbitration_id, self._message.encode(raw, scaling=False, strict=False), flags)

    def decode(self, data: bytes) -> tuple[Decoded, ...]:
        """The direction from now on."""
        values: dict[str, Any] = self._message.decode(data, decode_choices=False, scaling=False)  # type: ignore[assignment]
        return (Gear(self.wheel, self._signal.of(values)),)


def is_own_direction(signals: WheelSignals) -> bool:
    """Whether the direction stands in the message of the wheel itself."""
    return bool(signals.direction) and signals.direction.rpartition(".")[0] in ("", signals.message)
