"""Captures of what a UTM-30LX sent while it was driven in a circle in a room."""

import math
import struct

import numpy as np

from drivers.scip.codec import encode_key_values, encode_message
from drivers.scip.commands import ScanRequest
from drivers.scip.scan import encode_characters, encode_scan
from runtime.importers.parsing.scip_capture import UTM
from tests.support.runtime.carmen_logs import moments, room_ranges

REQUEST = ScanRequest("MD", 0, 1080)
START_S = 1_700_000_000


def described() -> bytes:
    return encode_message(b"PP", "00", encode_key_values(UTM.key_values()))


def scan_messages(count: int) -> list[bytes]:
    """Scans of a room at the rate of the mirror, each with the laser's own time."""
    messages = []
    for k, moment in enumerate(moments(count)):
        ranges_m = np.array(room_ranges(moment, 1081, -0.75 * math.pi, math.radians(0.25)))
        characters = encode_characters(np.round(ranges_m * 1000.0).astype(np.int32), 3)
        messages.append(encode_scan(REQUEST.encode(), "99", 5000 + 100 * k, characters.tobytes()))
    return messages


def as_records(messages: list[bytes]) -> bytes:
    """With the time of arrival before each."""
    content = b""
    for k, message in enumerate(messages):
        content += struct.pack(">III", START_S + k // 10, k % 10 * 100_000, len(message)) + message
    return content
