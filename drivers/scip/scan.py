"""Scan messages: encoded ranges, intensities and echoes to arrays and back.

The usual message has a fixed layout, so it is decoded as one table of bytes (about 40 us for 1081 steps); whatever
does not fit that layout goes line by line, which also finds the exact error.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.scip.codec import (
    DATA,
    FIRST_CHARACTER,
    LF,
    MICROSECOND_CHARACTERS,
    OK,
    DeviceTime,
    FramingError,
    Message,
    ScanSizeError,
    ScipError,
    StatusError,
    encode_time,
    parse_device_time,
    parse_message,
    summed,
    unsummed,
)
from drivers.scip.commands import ScanRequest

CodeArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
Echo = Literal["first", "strongest", "last"]
LINE = 64  # characters of data in a full line
ROW = LINE + 2  # with its sum and line feed
STATUS_LINES = {OK: b"00P", DATA: b"99b"}
ECHO_MARK = 0x26  # '&', outside of the encoded characters
STREAM_HEAD = re.compile(rb"\n99b\n([^\n]{5}|[^\n]{12})\n")  # status and time line of a streamed scan


@dataclass(frozen=True, slots=True, eq=False)
class ScanData:
    """One scan as the device counts: codes (N,) in millimetres or an error code below DMIN.

    time: the device's clock; remaining: scans still to come; intensities (N,) or None.
    """

    time: DeviceTime
    remaining: int
    codes: CodeArray
    intensities: CodeArray | None = None

    @property
    def counter_ms(self) -> int:
        """24-bit device clock."""
        return self.time.counter_ms


class ScanDecoder:
    """Decodes the messages that answer one request.

    echo: which echo of a multi-echo scan is kept; "strongest" needs intensities, without them it is the first.
    """

    def __init__(self, request: ScanRequest, echo: Echo = "first") -> None:
        self._request = request
        self._echo: Echo = echo
        self._width = request.range_characters + (3 if request.has_intensity else 0)
        full, last = divmod(request.beams * self._width - 1, LINE)
        encoded = request.encode()
        tail = len(request.string) + 1 if request.string else 0
        cut = len(encoded) - tail
        self._echo_tail = encoded[cut:]
        self._echo_head = encoded[: cut - 2] if request.is_stream else encoded[:cut]
        self._status = DATA if request.is_stream else OK
        time = MICROSECOND_CHARACTERS if request.in_microseconds else 4
        self._data_at = len(encoded) + 1 + 4 + time + 2  # after the lines of echo, status and time
        self._rows = (full, ROW)
        self._tail_at = self._data_at + full * ROW
        self._size = self._tail_at + last + 2

    def decode(self, raw: bytes) -> ScanData:
        """One whole message without its closing line feeds.

        Raises ChecksumError, FramingError, ScanSizeError, StatusError (the device says why there is no scan).
        """
        if len(raw) == self._size and not self._request.is_multi_echo:
            scan = self._decode_table(raw)
            if scan is not None:
                return scan
        return self.decode_message(parse_message(raw))

    def decode_message(self, message: Message) -> ScanData:
        """The same line by line."""
        remaining = self._remaining(message.echo)
        if message.legacy or message.status != self._status:
            raise StatusError(self._request.command, message.status)
        if len(message.lines) < 2:
            raise FramingError(f"scan message {message.echo!r} has {len(message.lines)} lines, expected time and data")
        time = parse_device_time(message.lines[0])
        payload = [unsummed(line) for line in message.lines[1:]]
        if any(len(line) != LINE for line in payload[:-1]) or len(payload[-1]) > LINE:
            raise FramingError(f"scan message {message.echo!r} has a line that is not {LINE} characters long")
        characters = np.frombuffer(b"".join(payload), np.uint8)
        if self._request.is_multi_echo:
            return self._split(time, remaining, self._choose_echo(characters))
        if characters.size != self._request.beams * self._width:
            got = characters.size / self._width
            raise ScanSizeError(f"scan has {got:g} steps, {self._request.beams} were asked for")
        return self._split(time, remaining, _numbers(characters, self._request, self._width))

    def _decode_table(self, raw: bytes) -> ScanData | None:
        """The message of nominal layout; None where a line is not as expected, so that the slow way names it."""
        head = raw[: self._data_at].split(LF)
        if len(head) != 4 or head[1] != STATUS_LINES[self._status]:
            return None
        data = np.frombuffer(raw, np.uint8)
        rows = data[self._data_at : self._tail_at].reshape(self._rows)
        tail = data[self._tail_at :]
        # sums of eight bits suffice: only the lower six count
        sums = np.add.reduce(rows[:, :LINE], axis=1, dtype=np.uint8)
        tail_sum = np.add.reduce(tail[:-1], dtype=np.uint8)
        whole = (
            np.array_equal((sums & 0x3F) + np.uint8(FIRST_CHARACTER), rows[:, LINE])
            and (rows[:, LINE + 1] == LF[0]).all()
            and (tail_sum & 0x3F) + FIRST_CHARACTER == tail[-1]
        )
        if not whole:
            return None
        characters = np.concatenate((rows[:, :LINE].reshape(-1), tail[:-1]))
        remaining = self._remaining(head[0])
        return self._split(parse_device_time(head[2]), remaining, _numbers(characters, self._request, self._width))

    def _remaining(self, echo: bytes) -> int:
        """Scans still to come, from the echo. Raises FramingError if the echo answers another request."""
        head, tail = self._echo_head, self._echo_tail
        digits = echo[len(head) : len(echo) - len(tail)]
        if not echo.startswith(head) or not echo.endswith(tail) or len(digits) != (2 if self._request.is_stream else 0):
            raise FramingError(f"echo {echo[:24]!r} does not answer {self._request.encode()!r}")
        if not self._request.is_stream:
            return 0
        if not digits.isdigit():
            raise FramingError(f"echo {echo[:24]!r} does not say how many scans remain")
        return int(digits)

    def _choose_echo(self, characters: ByteArray) -> CodeArray:
        """One value a step out of `vvv&vvv...`. Raises FramingError, ScanSizeError."""
        marks = np.flatnonzero(characters == ECHO_MARK)
        values = _numbers(characters[characters != ECHO_MARK], self._request, self._width)
        # the mark at place p, with k marks before it, stands before value (p - k) / width
        further, odd = np.divmod(marks - np.arange(marks.size), self._width)
        is_outside = marks.size and (further[0] == 0 or further[-1] >= len(values))
        if is_outside or odd.any() or (np.diff(further) == 0).any():
            raise FramingError("echo marks are inside numbers or without a number")
        is_first = np.ones(len(values), bool)
        is_first[further] = False
        starts = np.flatnonzero(is_first)
        if starts.size != self._request.beams:
            raise ScanSizeError(f"scan has {starts.size} steps, {self._request.beams} were asked for")
        chosen = starts
        if self._echo == "last":
            chosen = np.append(starts[1:], len(values)) - 1
        elif self._echo == "strongest" and self._request.has_intensity:
            step = np.cumsum(is_first) - 1
            chosen = np.lexsort((-values[:, 1], step))[starts]
        kept: CodeArray = values[chosen]
        return kept

    def _split(self, time: DeviceTime, remaining: int, values: CodeArray) -> ScanData:
        if self._request.has_intensity:
            return ScanData(time, remaining, values[:, 0], values[:, 1])
        return ScanData(time, remaining, values[:, 0])


def _numbers(characters: ByteArray, request: ScanRequest, width: int) -> CodeArray:
    """Encoded characters to numbers, (values, 1) or (values, 2) with intensities. Raises FramingError."""
    if characters.size % width:
        raise FramingError(f"{characters.size} characters of data cannot be numbers of {width}")
    digits = characters - np.uint8(FIRST_CHARACTER)  # wraps below '0', which the next line catches
    if digits.size and digits.max() > 0x3F:
        raise FramingError("data holds a character that is not a digit of the encoding")
    columns = digits.reshape(-1, width).astype(np.int32)
    if request.range_characters == 2:
        return (columns[:, :1] << 6) | columns[:, 1:2]
    return (columns[:, 0::3] << 12) | (columns[:, 1::3] << 6) | columns[:, 2::3]


def encode_characters(codes: CodeArray, width: int) -> ByteArray:
    """Numbers (N,) as characters (N, width)."""
    shifts = np.arange(6 * (width - 1), -1, -6, dtype=np.int32)
    return (((codes[:, None] >> shifts) & 0x3F) + FIRST_CHARACTER).astype(np.uint8)


def encode_payload(characters: bytes) -> bytes:
    """Data cut into lines of 64 characters with their sums."""
    return b"".join(summed(characters[start : start + LINE]) for start in range(0, len(characters), LINE))


def encode_scan(echo: bytes, status: str, counter_ms: int, characters: bytes) -> bytes:
    """A whole scan message with its closing line feed."""
    return b"".join((echo, LF, summed(status.encode("ascii")), encode_time(counter_ms), encode_payload(characters), LF))


def scan_counters_ms(data: bytes) -> Iterator[int]:
    """24-bit device counters of the streamed scans whose time line lies whole in these raw bytes.

    A damaged time line is left out: its bytes tell nothing of the device's clock.
    """
    for head in STREAM_HEAD.finditer(data):
        try:
            yield parse_device_time(head.group(1)).counter_ms
        except ScipError:
            continue
