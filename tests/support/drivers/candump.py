"""Log files of `candump -l` (can-utils), line by line.

python-can's reader takes an error frame for a data frame unless its class is 0x80, and loses the class then.
"""

from collections.abc import Iterator
from pathlib import Path

from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame
from drivers.measurements import ProtocolError

ERROR_BIT, STANDARD_DIGITS = 0x20000000, 3


def read_candump(path: Path) -> Iterator[CanFrame]:
    """Frames of the file; stamp_ns is the time in the file, of the system clock of the machine that wrote it.

    Raises ProtocolError with file and line for a line that is none of candump's.
    """
    with path.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            if line.strip():
                try:
                    yield candump_frame(line)
                except (ValueError, IndexError) as error:
                    raise ProtocolError(
                        f"{path}, line {number}: {line.strip()[:60]!r} is no line of candump -l; "
                        "expected '(1700000000.000000) can0 181#00FFFFFF25001082'"
                    ) from error


def candump_frame(line: str) -> CanFrame:
    """One line as a frame. Raises ValueError or IndexError for anything else."""
    stamp, _, frame, *_ = line.split()
    seconds, _, fraction = stamp.strip("()").partition(".")
    stamp_ns = int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0")[:9])
    digits, _, payload = frame.partition("#")
    number = int(digits, 16)
    if len(digits) > STANDARD_DIGITS and number & ERROR_BIT:
        return CanFrame(stamp_ns, number & ~ERROR_BIT & 0x1FFFFFFF, bytes.fromhex(payload), ERROR)
    flags = EXTENDED if len(digits) > STANDARD_DIGITS else 0
    if payload.startswith("#"):
        return CanFrame(stamp_ns, number, bytes.fromhex(payload[2:]), flags | FD)
    if payload[:1] in ("R", "r"):
        return CanFrame(stamp_ns, number, b"", flags | REMOTE)
    return CanFrame(stamp_ns, number, bytes.fromhex(payload), flags)


def candump_line(frame: CanFrame, channel: str = "can0") -> str:
    """The frame as candump writes it, without the end of the line."""
    stamp = f"({frame.stamp_ns // 1_000_000_000}.{frame.stamp_ns % 1_000_000_000 // 1000:06d})"
    if frame.flags & ERROR:
        number = f"{frame.arbitration_id | ERROR_BIT:08X}"
    else:
        number = f"{frame.arbitration_id:08X}" if frame.flags & EXTENDED else f"{frame.arbitration_id:03X}"
    if frame.flags & REMOTE:
        return f"{stamp} {channel} {number}#R"
    separator = "##0" if frame.flags & FD else "#"
    return f"{stamp} {channel} {number}{separator}{frame.data.hex().upper()}"
