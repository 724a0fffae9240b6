"""The readable prefix of an MCAP file: everything up to the first byte that is missing or wrong, and nothing after.

The library's reader is not used because it accepts a chunk whose checksum field was zeroed, and because this reads
a message in a tenth of its time. Format: https://mcap.dev/spec

MCAP leaves metadata, message indexes and the heads of chunks without a checksum until the file is finished. So that
every byte of a file that was cut off counts too, the recorder writes a metadata record "checkpoint" after the head and
after each chunk: the CRC-32 of all bytes before it.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import zstandard

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA, DATA_END = 2, 3, 4, 5, 6, 9, 12, 15
LARGEST_RECORD_BYTES = 1 << 30
RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
CHUNK_HEAD = struct.Struct("<QQQI")
CHECKPOINT = "checkpoint"


def checkpoint(crc: int) -> dict[str, str]:
    """Values of the checkpoint that stands behind bytes of this CRC-32."""
    return {"crc32": f"{crc:08x}"}


class DamageError(ValueError):
    """The file cannot be believed beyond this byte; the message says why."""

    def __init__(self, offset: int, what: str) -> None:
        super().__init__(f"{what} at byte {offset}")
        self.offset = offset


class McapPrefix:
    """Reads one file from its start. `damage` is None until the end is reached, then "" or what is wrong there."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size
        self.offset = 0
        self.damage: str | None = None
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        self._head_is_sure = False

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time ns, data) of every message in the prefix; metadata and attachments are kept on the way."""
        self._head_is_sure = False
        try:
            with self.path.open("rb") as stream:
                yield from self._messages(stream)
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

    def _messages(self, stream: BinaryIO) -> Iterator[tuple[str, int, bytes]]:
        if stream.read(len(MAGIC)) != MAGIC:
            raise DamageError(0, "not the start of an MCAP file")
        self.offset = len(MAGIC)
        data_crc = zlib.crc32(MAGIC)
        while True:
            head = stream.read(RECORD_HEAD.size)
            if not head:
                raise DamageError(self.offset, "the recording was cut off")
            if len(head) < RECORD_HEAD.size:
                raise DamageError(self.offset, "the file ends early")
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode == 0 or length > LARGEST_RECORD_BYTES:
                raise DamageError(self.offset, "no record begins")
            body = stream.read(length)
            if len(body) < length:
                raise DamageError(self.offset, "the last record is torn")
            if opcode == DATA_END:
                self._check_data_end(body, data_crc, stream)
                return
            crc_before, data_crc = data_crc, zlib.crc32(body, zlib.crc32(head, data_crc))
            try:
                if opcode == CHUNK:
                    self._head_is_sure = True
                    yield from self._chunk_messages(body)
                elif opcode == METADATA:
                    self._note_metadata(body, crc_before)
                elif opcode == ATTACHMENT:
                    name, data = _attachment(body)
                    self.attachments[name] = data
            except (struct.error, IndexError, KeyError, UnicodeDecodeError, ValueError) as error:
                raise DamageError(self.offset, f"damaged record ({error})") from error
            except zstandard.ZstdError as error:
                raise DamageError(self.offset, f"damaged chunk ({error})") from error
            self.offset += RECORD_HEAD.size + length

    def _note_metadata(self, body: bytes, crc_before: int) -> None:
        name, values = _metadata(body)
        if name == CHECKPOINT:
            if values != checkpoint(crc_before):
                raise ValueError("a byte before this checkpoint is not what was written")
            self._head_is_sure = True
        elif self._head_is_sure:
            raise ValueError("metadata where only a checkpoint can stand")
        else:
            self.metadata[name] = values

    def _check_data_end(self, body: bytes, data_crc: int, stream: BinaryIO) -> None:
        if body != struct.pack("<I", data_crc):
            raise DamageError(self.offset, "the checksum over the whole file does not match")
        tail = stream.read()
        covered, crc = tail[: -len(MAGIC) - 4], tail[-len(MAGIC) - 4 : -len(MAGIC)]
        if not tail.endswith(MAGIC) or crc != struct.pack("<I", zlib.crc32(covered)):
            raise DamageError(self.offset, "the index after the data is torn or damaged")
        self.offset = self.size

    def _chunk_messages(self, body: bytes) -> Iterator[tuple[str, int, bytes]]:
        data = _chunk_data(body)
        position = 0
        while position < len(data):
            opcode, length = RECORD_HEAD.unpack_from(data, position)
            position += RECORD_HEAD.size
            if opcode == MESSAGE:
                channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(data, position)
                yield self._topics[channel], log_ns, data[position + MESSAGE_HEAD.size : position + length]
            elif opcode == CHANNEL:
                channel, _ = struct.unpack_from("<HH", data, position)
                self._topics[channel], _ = _text(data, position + 4)
            position += length


def _chunk_data(body: bytes) -> bytes:
    """Uncompressed records of a chunk. Raises ValueError when they are not what was written."""
    _, _, size, crc = CHUNK_HEAD.unpack_from(body)
    compression, position = _text(body, CHUNK_HEAD.size)
    packed = body[position + 8 :]
    if compression != "zstd":
        raise ValueError(f"compression {compression!r} is not what this project writes")
    if size > LARGEST_RECORD_BYTES or zstandard.get_frame_parameters(packed).content_size != size:
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
    return name, values


def _attachment(body: bytes) -> tuple[str, bytes]:
    if zlib.crc32(body[:-4]) != struct.unpack_from("<I", body, len(body) - 4)[0]:
        raise ValueError("the checksum of the attachment does not match")
    name, position = _text(body, 16)
    _, position = _text(body, position)
    (length,) = struct.unpack_from("<Q", body, position)
    return name, body[position + 8 : position + 8 + length]
