"""Lines of candump to frames: the log format (-l), and the one for people (-ta, -tA).

(1436509052.249713) can0 181#2A366C2BBA, with ## before the flags of a CAN FD frame, #R for a remote frame; or
(1436509052.249713)  can0  181   [5]  2A 36 6C 2B BA. A line without a time is of no use.
"""

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame

LOGGED = re.compile(r"\((?P<time>[^)]+)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?P<rest>\S*)")
VIEWED = re.compile(
    r"\((?P<time>[^)]+)\)\s+(?P<channel>\S+)\s+(?:[TR]X\s+\S+\s+\S+\s+)?(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+"
    r"\[(?P<length>\d+)\]\s*(?P<rest>remote request|[0-9A-Fa-f ]*)"
)
BYTES = re.compile(r"(?:[0-9A-Fa-f]{2})*")
ERROR_FLAG = 0x20000000
LATEST_S = 4e9  # in the year 2096
CLASSIC_BYTES, FD_BYTES = 8, 64
FRAME_BYTES = 150  # of memory for each frame, with all that is made of it


class FrameColumns:
    """Frames in the order of writing: a million of them as values of their own would take 300 MB."""

    def __init__(self) -> None:
        self.times_s, self.channels = array("d"), array("B")
        self._ids, self._flags, self._ends, self._data = array("L"), array("B"), array("Q"), bytearray()

    def __len__(self) -> int:
        return len(self.times_s)

    def add(self, seconds: float, channel: int, frame: CanFrame) -> None:
        """One more; its stamp is not kept."""
        self.times_s.append(seconds)
        self.channels.append(channel)
        self._ids.append(frame.arbitration_id)
        self._flags.append(frame.flags)
        self._data += frame.data
        self._ends.append(len(self._data))

    def frame(self, row: int, stamp_ns: int) -> CanFrame:
        """The frame of a row, with this stamp."""
        begin = self._ends[row - 1] if row else 0
        return CanFrame(stamp_ns, self._ids[row], bytes(self._data[begin : self._ends[row]]), self._flags[row])


@dataclass(frozen=True, slots=True, eq=False)
class OrderedFrames:
    """Rows (n,) of columns in an order of their own, with their stamps_ns (n,)."""

    columns: FrameColumns
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    stamps_ns: np.ndarray[tuple[int], np.dtype[np.int64]]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[CanFrame]:
        for row, stamp_ns in zip(self.rows, self.stamps_ns, strict=True):
            yield self.columns.frame(int(row), int(stamp_ns))


def candump_line(line: str) -> tuple[float, str, CanFrame]:
    """Seconds, channel and frame (its stamp still 0). Raises ValueError with the reason."""
    found = LOGGED.match(line.strip())
    if found is not None:
        return _seconds(found["time"]), found["channel"], _logged(found["id"], found["rest"])
    found = VIEWED.match(line.strip())
    if found is None:
        raise ValueError("it is not a line of candump -l or candump -ta")
    return _seconds(found["time"]), found["channel"], _viewed(found["id"], int(found["length"]), found["rest"])


def _logged(identity: str, rest: str) -> CanFrame:
    if rest[:1] in ("R", "r"):
        return _frame(identity, b"", REMOTE)
    if rest.startswith("#"):
        return _frame(identity, _bytes(rest[2:], FD_BYTES), FD)
    return _frame(identity, _bytes(rest.replace(".", ""), CLASSIC_BYTES))


def _viewed(identity: str, length: int, rest: str) -> CanFrame:
    if rest == "remote request":
        return _frame(identity, b"", REMOTE)
    data = _bytes(rest.replace(" ", "")[: 2 * length], FD_BYTES)
    if len(data) != length:
        raise ValueError(f"it has {len(data)} bytes but announces [{length}]")
    return _frame(identity, data, FD if length > CLASSIC_BYTES else 0)


def _frame(identity: str, data: bytes, flags: int = 0) -> CanFrame:
    number = int(identity, 16)
    if len(identity) == len("12345678"):
        flags |= ERROR if number & ERROR_FLAG else EXTENDED
        number &= ERROR_FLAG - 1
    return CanFrame(0, number, data, flags)


def _bytes(text: str, most: int) -> bytes:
    if not BYTES.fullmatch(text) or len(text) > 2 * most:
        raise ValueError(f"{text[:20]!r} is not up to {most} bytes in hexadecimal")
    return bytes.fromhex(text)


def _seconds(text: str) -> float:
    """Seconds since 1970, or since the start where candump counted from there."""
    if "-" in text.strip()[1:]:
        return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
    seconds = float(text)
    if not abs(seconds) < LATEST_S:
        raise ValueError(f"{text} is not a time in seconds")
    return seconds
