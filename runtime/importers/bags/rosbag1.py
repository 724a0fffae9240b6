"""A rosbag 1 file, record by record, as `rosbag reindex` reads it: its index is not needed and not believed."""

import bz2
import os
import struct
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from lz4.frame import LZ4FrameDecompressor

from runtime.bounded_read import open_regular
from runtime.importers.bags.message import BROKEN, LARGEST_CHUNK, LARGEST_RECORD, BagMessage, note_topic
from runtime.importers.parsing.inflation import Inflation

ROSBAG1 = b"#ROSBAG V2.0"
MESSAGE, CHUNK, CONNECTION = b"\x02", b"\x05", b"\x07"  # kinds of records that are read
LARGEST_HEADER = 1 << 16


class Bag1:
    """See Bag. Damaged chunks are passed over; where a record ends early so does the bag."""

    def __init__(self, source: Path) -> None:
        self.topics: dict[str, str] = {}
        self.damage = ""
        self._source = source
        self.size_bytes = source.stat().st_size
        self._names: dict[bytes, str] = {}
        for _ in self.messages(()):
            pass

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """See Bag."""
        self.damage = ""
        inflation = Inflation(self._source.stat().st_size)
        try:
            with open_regular(self._source) as stream:
                if not stream.readline(2 * len(ROSBAG1)).startswith(ROSBAG1):
                    raise ValueError("it does not begin like a bag of ROS 1")
                for fields, data in self._records(stream):
                    if fields["op"] != CHUNK:
                        yield from self._message(fields, data, topics)
                        continue
                    content = BytesIO(self._unpacked(fields, data, inflation))
                    for inner, inner_data in self._records(content):
                        inflation.take_record()
                        yield from self._message(inner, inner_data, topics)
        except BROKEN as error:
            self.damage = f"it is damaged ({error or type(error).__name__})"

    def _message(self, fields: dict[str, bytes], data: bytes, topics: Collection[str]) -> Iterator[BagMessage]:
        number = fields.get("conn", b"")
        if fields["op"] == CONNECTION:
            name = fields.get("topic", b"").decode("utf-8", "replace")
            note_topic(self.topics, name, _fields(data).get("type", b"").decode("latin-1"))
            self._names[number] = name
        elif fields["op"] == MESSAGE and self._names.get(number) in topics and len(fields.get("time", b"")) == 8:
            seconds, nanoseconds = struct.unpack("<II", fields["time"])
            yield BagMessage(self._names[number], seconds * 1_000_000_000 + nanoseconds, data, True)

    def _records(self, stream: BinaryIO) -> Iterator[tuple[dict[str, bytes], bytes]]:
        """(fields of the header, data) of the records that are read; a chunk that is cut off is given as it is."""
        begun = stream.tell()
        end = stream.seek(0, os.SEEK_END)
        stream.seek(begun)
        while size := stream.read(4):
            length = int.from_bytes(size, "little")
            header = stream.read(min(length, LARGEST_HEADER))
            fields, told = _fields(header), stream.read(4)
            if len(told) < 4 or len(header) < length or "op" not in fields:
                self.damage = f"a record at byte {stream.tell()} is none, or ends early"
                return
            length = int.from_bytes(told, "little")
            kind = fields["op"]
            if kind not in (MESSAGE, CHUNK, CONNECTION) or length > (
                LARGEST_CHUNK if kind == CHUNK else LARGEST_RECORD
            ):
                self.damage = f"a chunk of {length} bytes is left out" if kind == CHUNK else self.damage
                if stream.seek(length, os.SEEK_CUR) > end:
                    self.damage = f"the record at byte {end} ends early"
                continue
            data = stream.read(length)
            if len(data) < length:
                self.damage = f"the record at byte {stream.tell()} ends early"
                if kind != CHUNK:
                    return
            yield fields, data

    def _unpacked(self, fields: dict[str, bytes], data: bytes, inflation: Inflation) -> bytes:
        """What a chunk holds; nothing where it is damaged. Raises ValueError for one that unpacks to too much."""
        most = min(LARGEST_CHUNK, inflation.left) + 1
        try:
            match fields.get("compression"):
                case b"bz2":
                    content = bz2.BZ2Decompressor().decompress(data, most)
                case b"lz4":
                    content = bytes(LZ4FrameDecompressor().decompress(data, most))
                case _:
                    return data
        except BROKEN as error:
            self.damage = f"a chunk is damaged ({error})"
            return b""
        inflation.take(len(content))
        if len(content) > LARGEST_CHUNK:
            raise ValueError(f"a chunk unpacks to more than {LARGEST_CHUNK} bytes")
        return content


def _fields(header: bytes) -> dict[str, bytes]:
    """The name=value pairs of a header."""
    fields, at = {}, 0
    while at + 4 <= len(header):
        length = int.from_bytes(header[at : at + 4], "little")
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        fields[name.decode("latin-1")] = value
        at += 4 + length
    return fields
