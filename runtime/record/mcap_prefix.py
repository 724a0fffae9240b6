"""The readable prefix of an MCAP file: everything up to the first byte that is missing or wrong, and nothing after.

The library's reader is not used because it accepts a chunk whose checksum field was zeroed, and because this reads
a message in a tenth of its time. Format: https://mcap.dev/spec

MCAP leaves metadata, message indexes and the heads of chunks without a checksum until the file is finished. So the
recorder writes a metadata record "checkpoint" after the head and after each chunk: the CRC-32 of all bytes before it.
"""

import re
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard

from runtime.bounded_read import open_regular

MAGIC = b"\x89MCAP0\r\n"
HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, ATTACHMENT, METADATA, DATA_END = 1, 3, 4, 5, 6, 7, 9, 12, 15
OUTSIDE_CHUNKS = frozenset((HEADER, CHUNK, INDEX, ATTACHMENT, METADATA, DATA_END))
LARGEST_RECORD_BYTES = 32 << 20  # of any record and of what a chunk unpacks to: 100 times what is written
LARGEST_PACKING = 200  # a recorded chunk unpacks to 1.2 to 20 times its bytes
SMALL_CHUNK_BYTES = 64 << 10  # which may be packed in any way
MOST_PACKING, FREE_BYTES = 40, 4 << 20  # of all chunks so far together, and as much as may be packed in any way
LARGEST_HEAD_BYTES = 32 << 20  # of metadata and attachments together, which are kept in memory
METADATA_WEIGHT = 16  # memory that a dictionary of short texts takes for each of its bytes
LONGEST_TOPIC = 256
BLOCK_BYTES = 1 << 20
RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
CHUNK_HEAD = struct.Struct("<QQQI")
PACKED_HEAD = struct.Struct("<QQQI8sQ")  # of a chunk too, up to the bytes that are packed
ZSTD = b"\x04\0\0\0zstd"
INDEX_HEAD = struct.Struct("<HI")
CHECKPOINT = "checkpoint"
WHOLE_CHECKPOINT = re.compile(rb"checkpoint.{4}\x05\0{3}crc32\x08\0{3}[0-9a-f]{8}", re.DOTALL)


def checkpoint(crc: int) -> dict[str, str]:
    """Values of the checkpoint that stands behind bytes of this CRC-32."""
    return {"crc32": f"{crc:08x}"}


class DamageError(ValueError):
    """The file cannot be believed beyond this byte; the message says why."""

    def __init__(self, offset: int, what: str) -> None:
        super().__init__(f"{what} at byte {offset}")
        self.offset = offset


class ForeignError(ValueError):
    """Bytes whose checksums are right, and which no recorder of ours writes: too many, too large, or of no meaning."""


class Channel(NamedTuple):
    """What stands in a file of the messages of one topic: their encoding, and the schema by which others read them."""

    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class McapPrefix:
    """Reads one file from its start. `damage` is None until the end is reached, then "" or what is wrong there.

    foreign: the damage is none of a disk or a loss of power; somebody else has written this. cut_off: the file ends
    where a recorder that was killed may leave it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size
        self.offset = 0
        self.damage: str | None = None
        self.foreign = self.cut_off = False
        self._kept_bytes = self._unpacked_bytes = 0
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.channels: dict[str, Channel] = {}
        self._topics: dict[int, str] = {}
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._head_is_sure = False

    def messages(self, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time ns, data) of every message in the prefix; metadata and attachments are kept on the way.

        topics: the only ones that are given; the others are checked by their chunk's sum and stepped over.
        """
        self._head_is_sure = False
        self._kept_bytes = self._unpacked_bytes = 0
        try:
            if self.size < len(MAGIC):  # of many thousands it takes a while to open each
                raise DamageError(0, "not the start of an MCAP file")
            with open_regular(self.path) as stream:
                yield from self._messages(stream, topics)
            self.damage = ""
        except OSError as error:
            self.damage = f"it cannot be read ({error.strerror}) at byte {self.offset}"
        except DamageError as error:
            self.damage = str(error)
        if self.damage and not self._head_is_sure:
            self.metadata, self.attachments = {}, {}

    def read_head(self) -> None:
        """Read metadata and attachments that stand before the first chunk."""
        for _ in self.messages():
            break

    def _messages(self, stream: BinaryIO, topics: Collection[str] | None) -> Iterator[tuple[str, int, bytes]]:
        if stream.read(len(MAGIC)) != MAGIC:
            raise DamageError(0, "not the start of an MCAP file")
        self.offset = len(MAGIC)
        data_crc = zlib.crc32(MAGIC)
        while True:
            head = stream.read(min(RECORD_HEAD.size, self.size - self.offset))  # what a recorder adds is of later
            if not head:
                raise self._cut_off("the recording was cut off")
            if len(head) < RECORD_HEAD.size:
                raise self._cut_off("the file ends early")
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode not in OUTSIDE_CHUNKS or (length > LARGEST_RECORD_BYTES and length > self.size):
                raise DamageError(self.offset, "no record begins")
            if length > LARGEST_RECORD_BYTES:
                raise self._foreign(
                    f"a record of {length} bytes, more than the {LARGEST_RECORD_BYTES} that are allowed"
                )
            body = stream.read(min(length, self.size - self.offset - len(head)))
            if not _can_be_as_long(opcode, length, body):
                raise DamageError(self.offset, "a record with a wrong length")
            if len(body) < length:
                raise self._cut_off("the last record is torn")
            if opcode == DATA_END:
                self._check_data_end(body, data_crc, stream)
                return
            crc_before, data_crc = data_crc, zlib.crc32(body, zlib.crc32(head, data_crc))
            try:
                if opcode == CHUNK:
                    self._head_is_sure = True
                    yield from self._chunk_messages(body, topics)
                elif opcode == METADATA:
                    self._note_metadata(body, crc_before)
                elif opcode == ATTACHMENT:
                    name, data = _attachment(body)
                    self._keep(length)
                    self.attachments[name] = data
            except ForeignError as error:
                raise self._foreign(str(error)) from error
            except (struct.error, IndexError, KeyError, UnicodeDecodeError, ValueError) as error:
                raise DamageError(self.offset, f"damaged record ({error})") from error
            except zstandard.ZstdError as error:
                raise DamageError(self.offset, f"damaged chunk ({error})") from error
            self.offset += RECORD_HEAD.size + length

    def _note_metadata(self, body: bytes, crc_before: int) -> None:
        name, values = _metadata(body)
        if name == CHECKPOINT:
            if values != checkpoint(crc_before):
                raise ValueError("a byte before this checkpoint differs from what was written")
            self._head_is_sure = True
        elif self._head_is_sure:
            raise ValueError("metadata where only a checkpoint can be")
        else:
            self._keep(METADATA_WEIGHT * len(body))
            self.metadata[name] = values

    def _keep(self, size: int) -> None:
        """Count what stays in memory. Raises ForeignError."""
        self._kept_bytes += size
        if self._kept_bytes > LARGEST_HEAD_BYTES:
            raise ForeignError(f"metadata and attachments that take more than {LARGEST_HEAD_BYTES} bytes of memory")

    def _cut_off(self, what: str) -> DamageError:
        self.cut_off = True
        return DamageError(self.offset, what)

    def _foreign(self, what: str) -> DamageError:
        self.foreign = True
        return DamageError(self.offset, what)

    def _check_data_end(self, body: bytes, data_crc: int, stream: BinaryIO) -> None:
        if body != struct.pack("<I", data_crc):
            raise DamageError(self.offset, "the checksum over the whole file does not match")
        crc, left = 0, self.size - stream.tell() - len(MAGIC) - 4  # an index is shorter than what it points to
        while 0 < left <= max(LARGEST_RECORD_BYTES, self.offset) and (block := stream.read(min(left, BLOCK_BYTES))):
            crc, left = zlib.crc32(block, crc), left - len(block)
        if left or stream.read(len(MAGIC) + 5) != struct.pack("<I", crc) + MAGIC:
            raise DamageError(self.offset, "the index after the data is torn or damaged")
        self.offset = self.size

    def _chunk_messages(self, body: bytes, topics: Collection[str] | None) -> Iterator[tuple[str, int, bytes]]:
        data = _chunk_data(body)
        self._unpacked_bytes += len(data)
        if self._unpacked_bytes > FREE_BYTES + MOST_PACKING * self.offset:
            raise ForeignError(f"chunks that unpack to {self._unpacked_bytes} bytes so far")
        position = 0
        try:
            while position < len(data):
                opcode, length = RECORD_HEAD.unpack_from(data, position)
                position += RECORD_HEAD.size
                if position + length > len(data):
                    raise ForeignError("a chunk whose last record is longer than the chunk")
                if opcode == MESSAGE:
                    channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(data, position)
                    topic = self._topics[channel]
                    if topics is None or topic in topics:
                        yield topic, log_ns, data[position + MESSAGE_HEAD.size : position + length]
                elif opcode == CHANNEL:
                    self._note_channel(data, position)
                elif opcode == SCHEMA:
                    self._note_schema(data, position, length)
                position += length
        except (struct.error, KeyError, UnicodeDecodeError) as error:  # though its checksum is right
            raise ForeignError(f"a chunk without meaning ({error!r})") from error

    def _note_channel(self, data: bytes, position: int) -> None:
        channel, schema = struct.unpack_from("<HH", data, position)
        topic, position = _text(data, position + 4)
        encoding, _ = _text(data, position)
        if max(len(topic), len(encoding)) > LONGEST_TOPIC:
            raise ForeignError(f"a topic of {len(topic)} characters, more than the {LONGEST_TOPIC} that are allowed")
        self._topics[channel] = topic
        self.channels[topic] = Channel(encoding, *self._schemas.get(schema, ("", "", b"")))

    def _note_schema(self, data: bytes, position: int, length: int) -> None:
        self._keep(length)
        (schema,) = struct.unpack_from("<H", data, position)
        name, position = _text(data, position + 2)
        encoding, position = _text(data, position)
        (size,) = struct.unpack_from("<I", data, position)
        self._schemas[schema] = (name, encoding, data[position + 4 : position + 4 + size])


def _can_be_as_long(opcode: int, length: int, body: bytes) -> bool:
    """Whether a record begins like this and has this length; body: what of it lies in the file.

    A length that was changed must not pass for the torn end of a killed run: all after it would be lost unsaid.
    """
    if opcode == DATA_END:
        return length == struct.calcsize("<I")
    if opcode == INDEX and len(body) >= INDEX_HEAD.size:
        _, size = INDEX_HEAD.unpack_from(body)
        return length == INDEX_HEAD.size + int(size)
    if opcode == CHUNK and len(body) >= PACKED_HEAD.size:
        *_, compression, packed = PACKED_HEAD.unpack_from(body)
        return bool(compression != ZSTD or length == PACKED_HEAD.size + packed)
    return len(body) == length or WHOLE_CHECKPOINT.search(body) is None


def _chunk_data(body: bytes) -> bytes:
    """Uncompressed records of a chunk. Raises ValueError when they are not what was written."""
    _, _, size, crc = CHUNK_HEAD.unpack_from(body)
    compression, position = _text(body, CHUNK_HEAD.size)
    packed = body[position + 8 :]
    if compression != "zstd":
        raise ValueError(f"compression {compression!r} is not used by this project")
    if size > min(LARGEST_RECORD_BYTES, max(SMALL_CHUNK_BYTES, LARGEST_PACKING * len(packed))):
        raise ForeignError(f"a chunk of {len(packed)} bytes that would unpack to {size}")
    if zstandard.get_frame_parameters(packed).content_size != size:
        raise ValueError("the size of the chunk does not match")  # said before so much memory is asked for
    data = zstandard.ZstdDecompressor().decompress(packed)
    if len(data) != size or zlib.crc32(data) != crc:
        raise ValueError("the checksum of the chunk does not match")
    return data


def _text(data: bytes, position: int) -> tuple[str, int]:
    """Length-prefixed text and the position after it."""
    (length,) = struct.unpack_from("<I", data, position)
    end = position + 4 + length
    if end > len(data):
        raise ValueError("a text is longer than its record")
    return data[position + 4 : end].decode(), end


def _metadata(body: bytes) -> tuple[str, dict[str, str]]:
    name, position = _text(body, 0)
    (length,) = struct.unpack_from("<I", body, position)
    end, position = position + 4 + length, position + 4
    values = {}
    while position < end:
        key, position = _text(body, position)
        values[key], position = _text(body, position)
    if not position == end == len(body):
        raise ValueError("the metadata do not end with their record")
    return name, values


def _attachment(body: bytes) -> tuple[str, bytes]:
    if zlib.crc32(body[:-4]) != struct.unpack_from("<I", body, len(body) - 4)[0]:
        raise ValueError("the checksum of the attachment does not match")
    name, position = _text(body, 16)
    _, position = _text(body, position)
    (length,) = struct.unpack_from("<Q", body, position)
    return name, body[position + 8 : position + 8 + length]
