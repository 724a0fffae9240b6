"""One frame of a CAN bus, with the stamp of its arrival."""

from typing import NamedTuple

EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8


class CanFrame(NamedTuple):
    """One frame off the bus. stamp_ns: host monotonic; flags: EXTENDED | REMOTE | ERROR | FD."""

    stamp_ns: int
    arbitration_id: int
    data: bytes
    flags: int = 0
