"""Faults of wheel nodes: each takes the frames of one beat and gives back what really goes onto the bus."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame
from drivers.settings.simulated_wheels import WheelFault
from drivers.wheels.readings import Wheel

ERROR_CLASSES = {
    "bus_off": (0x040, bytes(8)),
    "error_passive": (0x004, bytes((0, 0x30, 0, 0, 0, 0, 0, 0))),
    "error_warning": (0x004, bytes((0, 0x0C, 0, 0, 0, 0, 0, 0))),
    "error_flood": (0x088, bytes(8)),
}
RESTARTED = 0x100
SILENCING = ("bus_off", "error_flood", "silence_all")  # nothing else comes through meanwhile


@dataclass(slots=True)
class ActiveFault:
    """A fault that is on, with when it ends and what it has to remember."""

    fault: WheelFault
    since_ns: int
    held: CanFrame | None = None

    def has_begun(self, now_ns: int) -> bool:
        """True from its beginning on."""
        return now_ns >= self.since_ns

    def is_over(self, now_ns: int) -> bool:
        """True where its time has run out."""
        duration_ns = self.fault.duration_s * 1e9
        return duration_ns > 0 and now_ns - self.since_ns >= duration_ns

    def affects(self, wheel: Wheel) -> bool:
        """True where this wheel's frames are meant; what silences the bus silences both."""
        return self.fault.kind in SILENCING or self.fault.wheel in ("both", wheel.value)


def with_fault(
    frames: list[CanFrame],
    active: ActiveFault,
    rng: np.random.Generator,
    second: Callable[[], CanFrame],
    crc_byte: int = -1,
) -> list[CanFrame]:
    """The frames of one wheel and one beat as they arrive. second: a frame of the other node under the same id;
    crc_byte: place of the checksum."""
    name = active.fault.kind
    if name in SILENCING or name == "silence":
        return []
    if name == "second_sender":
        return [*frames, second()]
    result: list[CanFrame] = []
    for frame in frames:
        hit = rng.random() < active.fault.probability
        match name:
            case "loss" if hit:
                continue
            case "duplicate" if hit:
                result += [frame, frame]
            case "reorder":
                result += _swapped(frame, active, hit)
            case "bad_crc" if hit:
                data = bytearray(frame.data)
                data[crc_byte] ^= 0x5A
                result.append(frame._replace(data=bytes(data)))
            case "bad_length" if hit:
                result.append(frame._replace(data=frame.data[: len(frame.data) - 3]))
            case "remote" if hit:
                result.append(frame._replace(data=b"", flags=frame.flags | REMOTE))
            case "fd" if hit:
                result.append(frame._replace(flags=frame.flags | FD))
            case "extended" if hit:
                result.append(frame._replace(flags=frame.flags | EXTENDED))
            case _:
                result.append(frame)
    return result


def error_frame(name: str, now_ns: int) -> CanFrame | None:
    """The error frame that a controller would report for this fault, if it reports one."""
    if name not in ERROR_CLASSES:
        return None
    error_class, data = ERROR_CLASSES[name]
    return CanFrame(now_ns, error_class, data, ERROR)


def restarted_frame(now_ns: int) -> CanFrame:
    """What a controller reports when it is back after bus-off."""
    return CanFrame(now_ns, RESTARTED, bytes(8), ERROR)


def _swapped(frame: CanFrame, active: ActiveFault, hit: bool) -> list[CanFrame]:
    """Hold every second frame back until the next has gone."""
    held, active.held = active.held, None
    if held is not None:
        return [frame, held]
    if hit:
        active.held = frame
        return []
    return [frame]
