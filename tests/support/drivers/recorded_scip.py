"""The recorded session of a real UTM-30LX, or a skip that says where it should be."""

import struct
from collections.abc import Iterator

import pytest

from runtime.source_tree import SHARED_DATA

FOLDER = SHARED_DATA / "scip_capture_utm30lx"


def recorded_chunks() -> Iterator[tuple[int, bytes]]:
    """Host nanoseconds and bytes of every read from the sensor."""
    path = FOLDER / "example_utm_30lx.logr"
    if not path.exists():
        pytest.skip(f"{path} is absent: the recorded SCIP session is not part of the repository")
    log, place = path.read_bytes(), 0
    while place < len(log):
        seconds, microseconds, length = struct.unpack_from(">III", log, place)
        place += 12
        yield seconds * 1_000_000_000 + microseconds * 1000, log[place : place + length]
        place += length
