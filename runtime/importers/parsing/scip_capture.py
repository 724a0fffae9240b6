"""Captures of what a Hokuyo sent, to scans: the bytes as they are, or in records with the time of their arrival.

A record: seconds, microseconds and length, 32 bits each and big-endian, then so many bytes (.logr of hokuyoaist).
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.events import EventLog
from drivers.laser.clock import LaserClock
from drivers.laser.scans import ScanAssembly
from drivers.measurements import Scan
from drivers.scip.codec import LF, OK, ScipError, StatusError, parse_key_values, parse_message, parse_time, unsummed
from drivers.scip.commands import ScanRequest, parse_scan_request
from drivers.scip.framing import MessageStream, RawMessage
from drivers.scip.model import Parameters, parse_parameters
from drivers.scip.scan import STATUS_LINES
from drivers.settings.laser import LaserSettings
from runtime.bounded_read import open_regular

RECORD = struct.Struct(">III")
LARGEST_RECORD = 1 << 16
MOST_MESSAGES = 300_000  # two hours of the fastest laser
KEPT_BYTES, KEPT_TIMES = 150_000_000, 4  # of memory for the scans: so much, or so many times the size of the capture
SCAN_BYTES, BEAM_BYTES = 1500, 12  # of memory for a scan and for each beam, with all that is made of them
MOST_REQUESTS = 16  # of which answers are decoded; a program asks for one or two
COMMAND = re.compile(rb"(?:SCIP2\.0|[A-Z]{2}[0-9A-Za-z;._+@ ]{0,40})")
DRIFT_MAX_PPM = 200.0
URG = Parameters("URG-04LX", 20, 5600, 1024, 44, 725, 384, 600)
UTM = Parameters("UTM-30LX", 23, 60000, 1440, 0, 1080, 540, 2400)
USELESS = {
    "checksum_errors": "a checksum is wrong",
    "framing_errors": "the message is incomplete",
    "wrong_size": "another number of steps than was asked for",
    "stale_stamp": "the laser's clock stood still",
    "frozen_scans": "the ranges are frozen",
    "future_stamps": "the stamp is after the arrival",
    "out_of_order": "the stamp is not later than the one before",
    "refused": "the laser said why it sends none",
}


@dataclass(slots=True)
class Capture:
    """What a capture held. useless: messages of scans by the reason why there is no scan of them.

    is_guessed: the laser's own description was not captured. torn: bytes at the end that are no whole message. is_cut:
    more messages followed than fit.
    """

    scans: list[Scan] = field(default_factory=list)
    useless: dict[str, int] = field(default_factory=dict)
    messages: int = 0
    parameters: Parameters | None = None
    is_guessed: bool = False
    torn: int = 0
    is_cut: bool = False


def is_scip(head: bytes) -> bool:
    """Whether a file begins like a capture: with a reply, or with a record of one."""
    echo, _, rest = head.lstrip(LF).partition(LF)
    status = rest.partition(LF)[0]
    try:
        if COMMAND.fullmatch(echo) and len(unsummed(status)) == 2:
            return True
    except ScipError:
        pass
    begun = any(LF + status + LF in head for status in STATUS_LINES.values())  # in the middle of a message
    return begun or (_begins_a_record(head, 0) and head[RECORD.size : RECORD.size + 1].isalpha())


def chunks(source: Path) -> Iterator[tuple[int | None, bytes]]:
    """(arrival ns, bytes); None where the capture is nothing but the bytes. Raises OSError."""
    with open_regular(source) as stream:
        head = stream.read(RECORD.size + 1)
        if not _begins_a_record(head, 0):
            stream.seek(0)
            yield from ((None, block) for block in iter(lambda: stream.read(LARGEST_RECORD), b""))
            return
        while _begins_a_record(head, 0):
            seconds, microseconds, length = RECORD.unpack_from(head)
            yield seconds * 1_000_000_000 + microseconds * 1000, head[RECORD.size :] + stream.read(length - 1)
            head = stream.read(RECORD.size + 1)


def read_capture(path: Path) -> Capture:
    """All scans of a capture. Raises OSError."""
    capture = Capture(parameters=_described(path))
    settings, clock, events = LaserSettings(), LaserClock(DRIFT_MAX_PPM), EventLog("laser")
    assemblies: dict[ScanRequest, ScanAssembly] = {}
    room_bytes = max(KEPT_BYTES, KEPT_TIMES * path.stat().st_size)
    for message in _messages(path, capture):
        if room_bytes < 0:
            capture.is_cut = True
            break
        capture.messages += 1
        request = _request(message)
        if request is None:
            continue
        if capture.parameters is None:
            capture.parameters, capture.is_guessed = (URG if request.last_step <= URG.last_step else UTM), True
        if request not in assemblies and len(assemblies) == MOST_REQUESTS:
            events.count("refused")
            continue
        if request not in assemblies:
            assemblies[request] = ScanAssembly(settings, capture.parameters, request, clock, events, {})
        try:
            scan = assemblies[request].take(message)
        except StatusError:
            events.count("refused")
        except ScipError:
            continue  # counted by the assembly
        else:
            if scan is not None:
                capture.scans.append(scan)
                room_bytes -= SCAN_BYTES + BEAM_BYTES * scan.ranges_m.size
    capture.useless = {reason: events.counters[kind] for kind, reason in USELESS.items() if events.counters[kind]}
    return capture


def _messages(path: Path, capture: Capture) -> Iterator[RawMessage]:
    """Whole messages with their arrival, without arrivals that of the laser's clock; says what is left at the end."""
    stream, last_ms, total_ms, count = MessageStream(), -1, 0, 0
    for stamp_ns, data in chunks(path):
        for message in stream.feed(stamp_ns or 0, data):
            count += 1
            if count > MOST_MESSAGES:
                capture.is_cut = True
                return
            if stamp_ns is not None:
                yield message
                continue
            if (counter_ms := _counter_ms(message)) is not None:
                total_ms += (counter_ms - last_ms) % (1 << 24) if last_ms >= 0 else 0
                last_ms = counter_ms
            yield RawMessage(total_ms * 1_000_000, message.data)
    capture.torn = stream.pending_bytes


def _counter_ms(message: RawMessage) -> int | None:
    """The laser's clock in a scan."""
    lines = message.data.split(LF, 3)
    try:
        return parse_time(lines[2]) if len(lines) > 2 and _request(message) is not None else None
    except ScipError:
        return None


def _described(path: Path) -> Parameters | None:
    """The laser's answer to PP, None where none was captured."""
    for message in _messages(path, Capture()):
        if message.data.startswith(b"PP"):
            try:
                reply = parse_message(message.data)
                if reply.status == OK:
                    return parse_parameters(parse_key_values(reply))
            except ScipError:
                continue
    return None


def _request(message: RawMessage) -> ScanRequest | None:
    """What a message answers, without the scans that are still to come; None where it is no scan."""
    try:
        request = parse_scan_request(message.data.partition(LF)[0])
    except (ScipError, StatusError):
        return None
    return replace(request, count=0) if request.last_step >= request.first_step else None


def _begins_a_record(content: bytes, place: int) -> bool:
    if place + RECORD.size >= len(content):
        return False
    microseconds, length = struct.unpack_from(">II", content, place + 4)
    return bool(microseconds < 1_000_000 and 0 < length <= LARGEST_RECORD)
