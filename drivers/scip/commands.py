"""The requests of SCIP 2.0 that carry parameters: built by the driver, parsed by the simulated device."""

import re
from dataclasses import dataclass, replace

from drivers.scip.codec import FramingError, StatusError

STREAM_COMMANDS = ("MD", "MS", "ME", "ND", "NE")
SINGLE_COMMANDS = ("GD", "GS", "GE", "HD", "HE")
TWO_CHARACTER_COMMANDS = ("MS", "GS")
INTENSITY_COMMANDS = ("ME", "GE", "NE", "HE")
MULTI_ECHO_COMMANDS = ("ND", "NE", "HD", "HE")
STREAM_PARAMETERS = 13
SINGLE_PARAMETERS = 10
STRING_CHARACTERS = re.compile(r"[A-Za-z0-9 ._+@]*")


@dataclass(frozen=True, slots=True)
class ScanRequest:
    """What MD, MS, ME, ND, NE ask for as a stream, and GD, GS, GE, HD, HE once.

    Steps are the device's own numbers, both included. cluster: steps joined to one value (0 means 1).
    interval: scans left out after each one sent. count: scans to send, 0 for endless. in_microseconds: with stamps of
    that resolution, which UST firmware gives to a command behind a %.
    """

    command: str
    first_step: int
    last_step: int
    cluster: int = 1
    interval: int = 0
    count: int = 0
    string: str = ""
    in_microseconds: bool = False

    @property
    def is_stream(self) -> bool:
        """True where the device goes on sending by itself."""
        return self.command in STREAM_COMMANDS

    @property
    def beams(self) -> int:
        """Values in a scan: the last cluster may be a part of one."""
        cluster = max(1, self.cluster)
        return (self.last_step - self.first_step) // cluster + 1

    @property
    def range_characters(self) -> int:
        """Characters of one range."""
        return 2 if self.command in TWO_CHARACTER_COMMANDS else 3

    @property
    def has_intensity(self) -> bool:
        """True where each range is followed by an intensity."""
        return self.command in INTENSITY_COMMANDS

    @property
    def is_multi_echo(self) -> bool:
        """True where a step may have several values."""
        return self.command in MULTI_ECHO_COMMANDS

    def encode(self) -> bytes:
        """The request without its line feed."""
        mark = "%" if self.in_microseconds else ""
        text = f"{mark}{self.command}{self.first_step:04d}{self.last_step:04d}{self.cluster:02d}"
        if self.is_stream:
            text += f"{self.interval:01d}{self.count:02d}"
        return (text + (f";{self.string}" if self.string else "")).encode("ascii")

    def echo(self, remaining: int) -> bytes:
        """The first line of a scan message: the request with the scans that are still to come."""
        return replace(self, count=remaining).encode() if self.is_stream else self.encode()


def parse_scan_request(line: bytes) -> ScanRequest:
    """The inverse of ScanRequest.encode.

    Raises StatusError with the status that a device answers: 0C too short, 0D too long, 0G string too long,
    0H bad character in it, 03 and 07 not numeric (SCIP 2.0, MD); FramingError if it is no scan command at all.
    """
    text, mark, string = line.decode("ascii", "replace").partition(";")
    command, parameters = text[:2], text[2:]
    if command not in STREAM_COMMANDS + SINGLE_COMMANDS:
        raise FramingError(f"{line[:16]!r} is not a request for scans")
    check_string(command, mark + string)
    wanted = STREAM_PARAMETERS if command in STREAM_COMMANDS else SINGLE_PARAMETERS
    if len(parameters) != wanted:
        raise StatusError(command, "0C" if len(parameters) < wanted else "0D")
    for first, last, status in ((0, 4, "01"), (4, 8, "02"), (8, 10, "03"), (10, 11, "06"), (11, 13, "07")):
        field = parameters[first:last]
        if field and not (field.isascii() and field.isdigit()):
            raise StatusError(command, status)
    first_step, last_step, cluster = int(parameters[:4]), int(parameters[4:8]), int(parameters[8:10])
    interval, count = (int(parameters[10]), int(parameters[11:])) if wanted == STREAM_PARAMETERS else (0, 0)
    return ScanRequest(command, first_step, last_step, cluster, interval, count, string)


def check_string(command: str, tail: str) -> None:
    """The free text after `;`. Raises StatusError 0G or 0H."""
    if len(tail) > 17:
        raise StatusError(command, "0G")
    if tail and not STRING_CHARACTERS.fullmatch(tail[1:]):
        raise StatusError(command, "0H")
