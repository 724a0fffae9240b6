"""What nobody on board reads back: the inverse of each encoder that has none in the product."""

import struct

from runtime.messages.ros import ERROR, EXTENDED, FD, REMOTE
from runtime.messages.tick import decode


def decode_can_frame(topic: str, data: bytes) -> tuple[int, int, int, bytes]:
    """Stamp ns, arbitration id, flags and bytes, as RawTap.can_frame was given them."""
    message = decode(topic, data)
    stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    if topic == "/raw/can_fd":
        return stamp_ns, message.id, FD | (EXTENDED if message.is_extended else 0), message.data.tobytes()
    flags = EXTENDED * message.is_extended | REMOTE * message.is_rtr | ERROR * message.is_error
    return stamp_ns, message.id, flags, message.data.tobytes()[: message.dlc]


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Sequence number, wall time in ns, gid. Raises struct.error when it is not such an attachment."""
    seq, stamp_ns, _, gid = struct.unpack("<qqB16s", data)
    return seq, stamp_ns, gid
