"""Records as frames of a pipe: what the loop hands to the process that draws the review."""

import struct
from collections.abc import Iterator
from typing import IO

from runtime.messages.tick import Record

SEGMENT = "/segment"
"""Not in the record: a segment of it has been closed, whose number is the data as decimal digits."""

CARRIED = "/carried"
"""Not in the record: what one drawing process knew, for the one that goes on in its place."""

DRAWN = frozenset(("/scan", "/tick", "/estimate", "/timing", "/truth", "/gap", "/raw/laser"))
"""What the review is made from; other topics of a record need not be sent to it."""

FRAME = struct.Struct("<HqI")  # bytes of the topic, stamp ns, bytes of the data


def write_frame(pipe: IO[bytes], record: Record) -> None:
    """One record as bytes of a stream. Raises OSError when nobody reads."""
    topic = record.topic.encode()
    pipe.write(FRAME.pack(len(topic), record.stamp_ns, len(record.data)) + topic + record.data)


def read_frames(stream: IO[bytes]) -> Iterator[Record]:
    """Records until the stream ends; a frame that is cut off there is not one."""
    while len(head := stream.read(FRAME.size)) == FRAME.size:
        topic_length, stamp_ns, data_length = FRAME.unpack(head)
        body = stream.read(topic_length + data_length)
        if len(body) < topic_length + data_length:
            return
        yield Record(body[:topic_length].decode(), stamp_ns, body[topic_length:])
