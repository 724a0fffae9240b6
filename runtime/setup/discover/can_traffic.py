"""What frames on a CAN bus look like to someone who only listens: ids, rates, which bytes move, counters, checksums."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise, product
from statistics import median
from typing import Any

from crccheck.crc import Crc

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame

LEAST_FRAMES = 5  # below that, a constant may be a counter and any byte a checksum
COUNTING_SHARE = 0.9  # of steps by one that make an alive counter, where some frames are lost
POLYNOMIALS = {0x1D: "SAE J1850", 0x2F: "AUTOSAR", 0x07: "CCITT"}
NIBBLES = {"low": (0, 0x0F), "high": (4, 0x0F), "whole": (0, 0xFF)}


@dataclass(frozen=True, slots=True)
class IdTraffic:
    """One id. rate_hz: None for a single frame. moving_bytes: those that had more than one value.

    alive: place of a counter that rises by one with each frame, such as "byte 6, low half", "" for none. crc: place and
    kind of a checksum that fits every frame, "" for none.
    """

    number: int
    extended: bool
    length: int
    frames: int
    rate_hz: float | None
    moving_bytes: tuple[int, ...]
    alive: str
    crc: str

    @property
    def name(self) -> str:
        """The id as a data sheet writes it."""
        return f"0x{self.number:08X}" if self.extended else f"0x{self.number:03X}"

    def line(self) -> str:
        """For a person."""
        rate = "once" if self.rate_hz is None else f"{self.rate_hz:.1f} Hz"
        moving = ", ".join(map(str, self.moving_bytes)) or "none"
        more = "".join(f"; {each}" for each in (self.alive, self.crc) if each)
        return f"{self.name}  {rate}, {self.length} bytes, changing bytes: {moving}{more}"

    def as_json(self) -> dict[str, Any]:
        """As --json prints it."""
        return {"id": self.name} | asdict(self)


def traffic_of(frames: Iterable[CanFrame]) -> list[IdTraffic]:
    """Each id with its frames described, ids rising; error frames and remote requests are nobody's data."""
    by_id: dict[tuple[int, bool], list[CanFrame]] = {}
    for frame in frames:
        if not frame.flags & (ERROR | REMOTE | FD):
            by_id.setdefault((frame.arbitration_id, bool(frame.flags & EXTENDED)), []).append(frame)
    return [_described(number, extended, found) for (number, extended), found in sorted(by_id.items())]


def _described(number: int, extended: bool, frames: Sequence[CanFrame]) -> IdTraffic:
    length = min(len(frame.data) for frame in frames)
    gap_ns = median(after.stamp_ns - before.stamp_ns for before, after in pairwise(frames)) if len(frames) > 1 else 0
    rate_hz = 1e9 / gap_ns if gap_ns > 0 else None  # by the median: frames that the listener missed slow nothing down
    moving = tuple(k for k in range(length) if len({frame.data[k] for frame in frames}) > 1)
    enough = len(frames) >= LEAST_FRAMES
    alive = _alive(frames, moving) if enough else ""
    crc = _crc(number, frames, moving) if enough else ""
    return IdTraffic(number, extended, length, len(frames), rate_hz, moving, alive, crc)


def _alive(frames: Sequence[CanFrame], moving: tuple[int, ...]) -> str:
    """The first half byte or byte that counts frames; one that counts more slowly is data."""
    for place, (half, (shift, mask)) in product(moving, NIBBLES.items()):
        values = [frame.data[place] >> shift & mask for frame in frames]
        steps = [(after - before) & mask for before, after in pairwise(values)]
        if steps.count(1) >= COUNTING_SHARE * len(steps) and len(set(values)) > 2:
            where = f"byte {place}" if half == "whole" else f"byte {place}, {half} half"
            return f"alive counter in {where}"
    return ""


def _crc(number: int, frames: Sequence[CanFrame], moving: tuple[int, ...]) -> str:
    """A CRC-8 over the other bytes, with or without the id before them, that fits every frame."""
    identity = number.to_bytes(4, "little")[:2]
    payloads = list({frame.data for frame in frames})
    if len(payloads) < LEAST_FRAMES:
        return ""
    for place in reversed(moving):
        for polynomial, start, end, prefix in product(POLYNOMIALS, (0xFF, 0), (0xFF, 0), (identity, b"")):
            crc = Crc(8, polynomial, start, xor_output=end)
            if all(crc.calc(prefix + data[:place] + data[place + 1 :]) == data[place] for data in payloads):
                over = "id and data" if prefix else "data"
                return f"CRC-8 {POLYNOMIALS[polynomial]} over {over} in byte {place}"
    return ""
