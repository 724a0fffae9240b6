"""CAN frames to wheel readings and back; no bus, no thread, no clock.

The layouts (DBC, CiA 406, presets) are in layouts/; here is what they all come down to: a table from
arbitration id to the messages that matter.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from drivers.canbus.frame import FD, REMOTE, CanFrame


class Wheel(StrEnum):
    """Which wheel a frame speaks of."""

    LEFT = "left"
    RIGHT = "right"


class WheelReading(NamedTuple):
    """What one frame says of one wheel, before any judgement. None: the device does not send it.

    position: counts as the wire has them, not unwrapped; an int unless the device sends turns.
    speed: counts per second, sign as on the wire.
    direction: 1 or -1, by which both are multiplied where the device sends them without a sign; 0: it is not known.
    is_sentinel: the position is a value by which devices say "not available", such as all ones.
    """

    wheel: Wheel
    position: float | None
    speed: float | None = None
    status: int = 0
    status_ok: bool = True
    alive: int | None = None
    boot_id: int | None = None
    direction: int = 1
    is_sentinel: bool = False

    @property
    def signed_speed(self) -> float | None:
        """Counts per second, negative where the direction says so."""
        return -abs(self.speed) if self.speed is not None and self.direction < 0 else self.speed


class Gear(NamedTuple):
    """What another message says of the direction of one wheel: 1 or -1, 0 where it does not say."""

    wheel: Wheel
    direction: int


class NodeInfo(NamedTuple):
    """The slow message of a node; None: not sent."""

    wheel: Wheel
    counts_per_rev: int | None = None
    period_ms: int | None = None
    schema_version: int | None = None
    uptime_ms: int | None = None


class NodeState(NamedTuple):
    """CANopen heartbeat; 0 is the boot-up message, 5 operational (CiA 301, 7.2.8.3.2.2)."""

    wheel: Wheel
    state: int


class NodeAlarm(NamedTuple):
    """CANopen emergency; code 0 takes the alarm back (CiA 301, 7.2.7)."""

    wheel: Wheel
    code: int


class Refused(NamedTuple):
    """A frame with the id of a wheel that is not a message of it. reason: the counter's name."""

    wheel: Wheel
    reason: str


Decoded = WheelReading | Gear | NodeInfo | NodeState | NodeAlarm | Refused
Decoder = Callable[[bytes], tuple[Decoded, ...]]


@dataclass(frozen=True, slots=True)
class Route:
    """What is expected under one arbitration id. length 0: any."""

    wheels: tuple[Wheel, ...]
    extended: bool
    length: int
    decode: Decoder


class WheelDecoder:
    """Decoder for all ids of a layout.

    modulus: counts after which each wheel's position wraps, 0 for never (turns in floating point).
    alive_modulus: the same for the rolling counter, 0 where none is sent.
    has_position: False where a wheel sends only its speed, which is then integrated.
    wake_up: frames to send when the bus has opened and after a node has booted (NMT start).
    unsigned: wheels whose way back nothing tells from the way forth. gears: those whose direction is another message's.
    """

    def __init__(
        self,
        routes: dict[int, Route],
        modulus: dict[Wheel, float],
        alive_modulus: dict[Wheel, int],
        has_position: bool = True,
        wake_up: tuple[CanFrame, ...] = (),
        unsigned: tuple[Wheel, ...] = (),
        gears: tuple[Wheel, ...] = (),
    ) -> None:
        self.routes = routes
        self.modulus = modulus
        self.alive_modulus = alive_modulus
        self.has_position = has_position
        self.wake_up = wake_up
        self.unsigned = unsigned
        self.gears = gears

    @property
    def ids(self) -> tuple[int, ...]:
        """Arbitration ids that matter, for the filter in the kernel."""
        return tuple(self.routes)

    def decode(self, frame: CanFrame) -> tuple[Decoded, ...]:
        """What the frame says; empty for ids of others. Error frames are not for this function."""
        _, arbitration_id, data, flags = frame
        route = self.routes.get(arbitration_id)
        if route is None:
            return ()
        if flags != route.extended:
            reason = _wrong_format(flags, route.extended)
        elif route.length and len(data) != route.length:  # never the DLC: slcan believes any digit
            reason = "length"
        else:
            try:
                return route.decode(data)
            except Exception:  # noqa: BLE001 cantools and bitstruct raise what they like of bytes that do not fit
                reason = "undecodable"
        return tuple(Refused(wheel, reason) for wheel in route.wheels)


def _wrong_format(flags: int, extended: bool) -> str:
    if flags & REMOTE:
        return "remote"
    if flags & FD:
        return "fd"
    return "standard" if extended else "extended"
