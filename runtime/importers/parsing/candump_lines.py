"""Lines of candump to frames: the log format (-l), and the one for people (-ta, -tA).

(1436509052.249713) can0 181#2A366C2BBA, with ## before the flags of a CAN FD frame, #R for a remote frame; or
(1436509052.249713)  can0  181   [5]  2A 36 6C 2B BA. A line without a time is of no use.
"""

import re
from datetime import UTC, datetime

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
