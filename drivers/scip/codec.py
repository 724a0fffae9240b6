"""SCIP codec: bytes of the wire to values and back. No port, no thread, no clock.

A message is `echo LF status sum LF [line sum LF]... LF`; it ends in two line feeds and no line inside is empty.
Source: Hokuyo, Communication Protocol Specification for SCIP2.0 (C-42-03320B), and bytes of real sensors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from drivers.measurements import DeviceError, ProtocolError

LF = b"\n"
END = b"\n\n"
FIRST_CHARACTER = 0x30  # code of the value 0; 0x6f is 63
OK = "00"
DATA = "99"
WORDS_MOST = 200  # characters of a value of VV, PP, II; real ones have 60
MICROSECOND_CHARACTERS = 11
COUNTER_MS = 1 << 24  # the device's clock counts milliseconds in 24 bits


class ScipError(ProtocolError):
    """Bytes that are no valid SCIP; the base of all that the codec raises about bytes."""


class ChecksumError(ScipError):
    """A line whose last character is not the sum of the others: noise on the wire or a torn message."""


class FramingError(ScipError):
    """A message that lacks lines, or has lines of the wrong form: half of it is missing, or it is not SCIP."""


class ScanSizeError(ScipError):
    """A scan with more or fewer steps than were asked for."""


class StatusError(DeviceError):
    """The device refused a command; `status` holds its two characters (one in SCIP 1.1)."""

    def __init__(self, command: str, status: str, advice: str = "") -> None:
        tail = f"; {advice}" if advice else ""
        super().__init__(f"the laser answered {command} with status {status} ({status_meaning(status)}){tail}")
        self.command = command
        self.status = status


STATUS_MEANINGS = {
    "00": "done",
    "99": "scan data",
    "98": "measurement resumed",
    "0A": "the reply cannot be built",
    "0B": "buffer too short or command repeated",
    "0C": "too few parameters",
    "0D": "too many parameters",
    "0E": "unknown command",
    "0F": "not supported",
    "0G": "string longer than 16 characters",
    "0H": "character not allowed in a string",
    "0I": "firmware is being updated",
    "0L": "malfunction, needs a reboot",
    "0M": "unstable",
    "10": "not allowed in this state",
}


def status_meaning(status: str) -> str:
    """Plain words for a status; codes 01 to 09 mean something else for every command."""
    if status.isdigit() and len(status) == 2:
        code = int(status)
        if 21 <= code <= 49:
            return "stopped to verify an error"
        if 50 <= code <= 97:
            return "hardware trouble"
    return STATUS_MEANINGS.get(status, "a parameter is refused")


def is_fault(status: str) -> bool:
    """True for the states that only a reboot can end: 0L and 50 to 97 (SCIP 2.0, MD)."""
    return status == "0L" or (len(status) == 2 and status.isdigit() and 50 <= int(status) <= 97)


def is_transient(status: str) -> bool:
    """True for what a stream may say between scans without having ended: 0M, 21 to 49 and 98."""
    return status in ("0M", "98") or (len(status) == 2 and status.isdigit() and 21 <= int(status) <= 49)


def checksum(characters: bytes) -> int:
    """Code of the sum character: the lower six bits of the sum, moved into the printable range."""
    return (sum(characters) & 0x3F) + FIRST_CHARACTER


def summed(characters: bytes) -> bytes:
    """The line with its sum and line feed."""
    return b"%s%c\n" % (characters, checksum(characters))


def unsummed(line: bytes) -> bytes:
    """The line without its sum. Raises ChecksumError, FramingError for an empty line."""
    if len(line) < 2:
        raise FramingError(f"line {line!r} is too short to hold a checksum")
    if line[-1] != checksum(line[:-1]):
        raise ChecksumError(f"line {line[:20]!r} has the checksum {line[-1:]!r}, expected {chr(checksum(line[:-1]))!r}")
    return line[:-1]


def encode_number(value: int, width: int) -> bytes:
    """Six bits a character, most significant first: 5432 in width 3 is b"1Dh". Raises ValueError out of range."""
    if not 0 <= value < 1 << (6 * width):
        raise ValueError(f"{value} does not fit in {width} characters of six bits")
    return bytes(((value >> shift) & 0x3F) + FIRST_CHARACTER for shift in range(6 * (width - 1), -1, -6))


def decode_number(characters: bytes) -> int:
    """Inverse of encode_number. Raises FramingError for a character that is no digit of the code."""
    value = 0
    for character in characters:
        digit = character - FIRST_CHARACTER
        if not 0 <= digit <= 0x3F:
            raise FramingError(f"{characters[:8]!r} is not an encoded number")
        value = value << 6 | digit
    return value


@dataclass(frozen=True, slots=True)
class Message:
    """One reply: the command as it was sent, a status, and lines that still carry their sums.

    legacy: the status had one character and no sum, so the device speaks SCIP 1.1.
    """

    echo: bytes
    status: str
    lines: tuple[bytes, ...]
    legacy: bool = False


def parse_message(raw: bytes) -> Message:
    """One message without its closing line feeds. Raises FramingError or ChecksumError."""
    lines = raw.split(LF)
    if len(lines) < 2:
        raise FramingError(f"message {raw[:24]!r} has no status line")
    echo, status, *body = lines
    if not echo.isascii() or not status.isascii():
        raise FramingError(f"message {raw[:24]!r} is not ASCII")
    if len(status) == 1:
        return Message(echo, status.decode("ascii"), tuple(body), legacy=True)
    if len(status) != 3:
        raise FramingError(
            f"message {raw[:24]!r} has the status {status[:8]!r}, expected two characters and a checksum"
        )
    return Message(echo, unsummed(status).decode("ascii"), tuple(body))


def encode_message(echo: bytes, status: str, body: bytes = b"") -> bytes:
    """A whole reply with its closing line feed; `body` holds lines that already carry sums and line feeds."""
    return echo + LF + summed(status.encode("ascii")) + body + LF


def encode_legacy_message(echo: bytes, status: str, lines: tuple[bytes, ...] = ()) -> bytes:
    """A reply of SCIP 1.1: one character of status, no sums."""
    return LF.join((echo, status.encode("ascii"), *lines)) + END


def parse_key_values(message: Message, is_lenient: bool = False) -> dict[str, str]:
    """The `KEY:value;sum` lines of VV, PP and II, control characters shown as `?`.

    The sum is taken over the text before the last `;` (UTM-30LX P.1.05, measured). Other firmware includes the `;`,
    or leaves out everything from `<-` on; all three are accepted. is_lenient: for what is only told to people, any sum
    will do, and lines of another form are passed over. Raises FramingError or ChecksumError.
    """
    values: dict[str, str] = {}
    for line in message.lines:
        text, mark, total = line[:-2], line[-2:-1], line[-1:]
        is_sound = mark == b";" and b":" in text and text.isascii()
        if not is_sound and not is_lenient:
            raise FramingError(f"line {line[:40]!r} of {message.echo[:8]!r} is not of the form KEY:value;checksum")
        candidates = (text, text + b";", text.split(b"<-")[0])
        if not is_lenient and total[0] not in {checksum(candidate) for candidate in candidates}:
            raise ChecksumError(f"line {line[:40]!r} of {message.echo[:8]!r} has a wrong checksum")
        key, colon, value = text.decode("latin-1").partition(":")
        if colon:
            values[_printable(key)] = _printable(value)
    return values


def _printable(text: str) -> str:
    """A device's words as they may be shown: nothing that steers a terminal, and no more than a line."""
    return "".join(each if each.isprintable() else "?" for each in text[:WORDS_MOST])


def encode_key_values(values: Mapping[str, str]) -> bytes:
    """Lines of VV, PP and II as the UTM-30LX writes them."""
    lines = []
    for key, value in values.items():
        text = f"{key}:{value}".encode("ascii")
        lines.append(b"%s;%c\n" % (text, checksum(text)))
    return b"".join(lines)


class DeviceTime(NamedTuple):
    """The device's clock: milliseconds in 24 bits, and microseconds beyond them, None where they are not told."""

    counter_ms: int
    fraction_us: int | None = None


def parse_time(line: bytes) -> int:
    """The 24-bit counter of milliseconds of a time line. Raises FramingError or ChecksumError."""
    return parse_device_time(line).counter_ms


def parse_device_time(line: bytes) -> DeviceTime:
    """A time line: four characters of milliseconds, or eleven of microseconds where a command with % was asked (UST
    firmware 4.1.0b). Raises FramingError or ChecksumError.
    """
    characters = unsummed(line)
    if len(characters) == MICROSECOND_CHARACTERS:
        whole_ms, fraction_us = divmod(decode_number(characters), 1000)
        return DeviceTime(whole_ms % COUNTER_MS, fraction_us)
    if len(characters) != 4:
        raise FramingError(f"time line {line[:16]!r} has {len(characters)} characters, expected 4")
    return DeviceTime(decode_number(characters))


def encode_time(counter_ms: int) -> bytes:
    """A time line; the counter is cut to its 24 bits."""
    return summed(encode_number(counter_ms % COUNTER_MS, 4))
