"""Records of an MCAP file of whatever recorder: those that messages are made of, others are passed over unread.

Indexes, attachments, metadata and statistics are never held; checksums are not asked for, so that a damaged file is
read as far as it goes. Format: https://mcap.dev/spec
"""

import os
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import IO

import zstandard
from lz4.frame import LZ4FrameDecompressor

from runtime.importers.bags.message import LARGEST_CHUNK, LARGEST_RECORD
from runtime.importers.parsing.inflation import Inflation

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15
READ = (SCHEMA, CHANNEL, MESSAGE, CHUNK)
RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
CHUNK_SIZE_AT, CHUNK_TEXT_AT = 16, 28  # behind two times; behind size and checksum


def mcap_records(stream: IO[bytes], inflation: Inflation) -> Iterator[tuple[int, bytes]]:
    """(kind, body) of all schemas, channels and messages, also those in chunks. Raises one of BROKEN where it ends."""
    if stream.read(len(MAGIC)) != MAGIC:
        raise ValueError("it does not begin like an MCAP file")
    for kind, body in _records(stream):
        if kind == CHUNK:
            for record in _records(BytesIO(_unpacked(body, inflation))):
                inflation.take_record()
                yield record
        else:
            yield kind, body


def _records(stream: IO[bytes]) -> Iterator[tuple[int, bytes]]:
    is_file = not isinstance(stream, BytesIO)
    while head := stream.read(RECORD_HEAD.size):
        kind, length = RECORD_HEAD.unpack(head)
        if kind in (DATA_END, FOOTER):
            return
        if kind == CHUNK and length > LARGEST_CHUNK:
            raise ValueError(f"a chunk of {length} bytes")
        if kind not in READ or (kind != CHUNK and length > LARGEST_RECORD):
            stream.seek(length, os.SEEK_CUR)
            continue
        body = stream.read(length)
        if len(body) < length:
            raise EOFError("its last record is torn")
        yield kind, body
    if is_file:
        raise EOFError("it has no end")


def texts_of(body: bytes, at: int, count: int) -> tuple[int, list[str]]:
    """The number that a record begins with, and so many texts from `at` bytes behind it on."""
    (number,) = struct.unpack_from("<H", body)
    texts, place = [], 2 + at
    for _ in range(count):
        (length,) = struct.unpack_from("<I", body, place)
        texts.append(body[place + 4 : place + 4 + length].decode())
        place += 4 + length
    return number, texts


def message_of(body: bytes) -> tuple[int, int, bytes]:
    """(channel, log time ns, data) of a message."""
    channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(body)
    return channel, log_ns, body[MESSAGE_HEAD.size :]


def _unpacked(body: bytes, inflation: Inflation) -> bytes:
    """The records of a chunk. Raises ValueError where they are too many, and what the libraries raise."""
    (size,) = struct.unpack_from("<Q", body, CHUNK_SIZE_AT)
    (length,) = struct.unpack_from("<I", body, CHUNK_TEXT_AT)
    compression = body[CHUNK_TEXT_AT + 4 : CHUNK_TEXT_AT + 4 + length]
    packed = body[CHUNK_TEXT_AT + 4 + length + 8 :]
    if compression == b"":
        return packed
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk that would unpack to {size} bytes")
    inflation.take(size)
    match compression:
        case b"zstd":
            data = (
                zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)
                .stream_reader(packed, read_across_frames=True)
                .read(size)
            )
        case b"lz4":
            data = bytes(LZ4FrameDecompressor().decompress(packed, size))
        case _:
            raise ValueError(f"compression {compression[:20]!r} is not known")
    if len(data) < size:
        raise EOFError("a chunk ends early")
    return data
