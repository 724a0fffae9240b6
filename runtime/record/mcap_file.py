"""run.mcap while it is being written: records gather into chunks, chunks wait as bytes until the disk takes them."""

import fcntl
import hashlib
import os
import zlib
from collections import deque
from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from runtime.atomic_write import NEW_FILE_FLAGS, acting_as_owner
from runtime.errors import StorageError
from runtime.messages.definitions import TYPES, definition
from runtime.messages.tick import Record
from runtime.record.mcap_prefix import CHECKPOINT, Channel, checkpoint

NO_LIMIT = 1 << 62  # the library must never end a chunk by itself: only whole ticks may go to disk together
OFFLINE_CHUNK_BYTES = 256 * 1024


class PendingBytes:
    """The stream that the library writes to. It never fails: trouble with the disk must not reach its indexes."""

    def __init__(self) -> None:
        self.blocks: deque[memoryview] = deque()
        self.size = 0
        self.crc = 0
        self._position = 0

    def write(self, data: bytes) -> int:
        """Take bytes."""
        if data:
            self.blocks.append(memoryview(data))
            self.size += len(data)
            self.crc = zlib.crc32(data, self.crc)
            self._position += len(data)
        return len(data)

    def tell(self) -> int:
        """Bytes taken since the start."""
        return self._position

    def flush(self) -> None:
        """Nothing: RecordFile.write decides when the disk is asked."""


class RecordFile:
    """A new file of records. Every byte is checksummed; up to its last finished chunk it can always be read.

    No method but write and sync touches the disk. Not thread-safe: one thread owns it.
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes] | None = None
    ) -> None:
        """Open a file that must not exist. Raises StorageError."""
        try:
            with acting_as_owner(path.parent):
                self._descriptor = os.open(path, NEW_FILE_FLAGS, 0o644)
        except OSError as error:
            raise StorageError(f"{path} cannot be created ({error.strerror}); check the folder") from error
        fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # how others see that it is being written
        self.path = path
        self._digest = hashlib.sha256()
        self._pending = PendingBytes()
        self._offset = 0
        self._chunk_bytes = 0
        self._is_inside = False  # the library; stays so when something is raised there
        self._channels: dict[str, int] = {}
        self._writer = Writer(
            self._pending,  # type: ignore[arg-type]  # all that the library asks of it is write, tell, flush
            chunk_size=NO_LIMIT,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self._writer.start(profile="ros2")
        for name, values in metadata.items():
            self._writer.add_metadata(name, dict(values))
        for name, data in (attachments or {}).items():
            self._writer.add_attachment(0, 0, name, "application/octet-stream", data)
        self._writer.add_metadata(CHECKPOINT, checkpoint(self._pending.crc))

    @property
    def size(self) -> int:
        """Bytes that the disk has taken."""
        return self._offset

    @property
    def sha256(self) -> str:
        """Hash of the bytes that the disk has taken, as they were meant, hexadecimal."""
        return self._digest.hexdigest()

    def is_gone(self) -> bool:
        """Whether the file's name leads nowhere or elsewhere: removed, or another disk is mounted. Raises OSError."""
        try:
            there, mine = os.stat(self.path), os.fstat(self._descriptor)
        except FileNotFoundError:
            return True
        return (there.st_dev, there.st_ino) != (mine.st_dev, mine.st_ino)

    @property
    def is_torn(self) -> bool:
        """Whether something was raised while a record or a chunk was being made: what follows could not be read."""
        return self._is_inside

    @property
    def pending_bytes(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._pending.size

    @property
    def chunk_bytes(self) -> int:
        """Bytes in the chunk that is not finished."""
        return self._chunk_bytes

    def add(self, record: Record, foreign: Channel | None = None) -> None:
        """Into the chunk at hand. foreign: of a topic that is none of ours, as the file has it that it comes from."""
        self._is_inside = True
        channel = self._channels.get(record.topic)
        if channel is None:
            if foreign is None:
                name = TYPES[record.topic]
                foreign = Channel("cdr", name, "ros2msg", definition(name).encode())
            schema = 0  # of the format: none
            if foreign.schema_name:
                schema = self._writer.register_schema(foreign.schema_name, foreign.schema_encoding, foreign.schema)
            channel = self._writer.register_channel(record.topic, foreign.encoding, schema)
            self._channels[record.topic] = channel
        log_ns = max(0, record.stamp_ns)  # MCAP knows no time before zero; the message itself has the stamp
        self._writer.add_message(channel, log_ns, record.data, log_ns)
        self._chunk_bytes += len(record.data)
        self._is_inside = False

    def end_chunk(self) -> None:
        """All records so far become a chunk: from now on they can be read, once written."""
        if self._chunk_bytes:
            self._is_inside = True
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._writer.add_metadata(CHECKPOINT, checkpoint(self._pending.crc))
            self._chunk_bytes = 0
            self._is_inside = False

    def write(self) -> None:
        """Give the disk what it has not taken. Raises OSError; call again to go on where it stopped."""
        while self._pending.blocks:
            block = self._pending.blocks[0]
            taken = os.pwrite(self._descriptor, block, self._offset)
            self._digest.update(block[:taken])
            self._offset += taken
            self._pending.size -= taken
            if taken == len(block):
                self._pending.blocks.popleft()
            else:
                self._pending.blocks[0] = block[taken:]

    def sync(self) -> None:
        """Make sure that a loss of power takes nothing of what is written. Raises OSError."""
        os.fdatasync(self._descriptor)
        if self.is_gone():
            raise FileNotFoundError(2, "it was removed while being written")

    def finish(self) -> None:
        """Indexes and footer; then no more records."""
        self.end_chunk()
        self._is_inside = True
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._is_inside = False

    def protect(self) -> None:
        """Nobody shall write to it by mistake. Raises OSError."""
        os.fchmod(self._descriptor, 0o444)

    def close(self) -> None:
        """Give the file back to the system. Raises OSError."""
        os.close(self._descriptor)


class RunWriter:
    """Writes a run as fast as it can, on the caller's thread: for imports and replays, where nothing is late."""

    def __init__(
        self, path: Path, metadata: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes] | None = None
    ) -> None:
        self._file = RecordFile(path, metadata, attachments)

    def add(self, records: list[Record], foreign: Mapping[str, Channel] | None = None) -> None:
        """The records of one tick, never parted. foreign: topics that are none of ours. Raises StorageError."""
        for record in records:
            self._file.add(record, (foreign or {}).get(record.topic))
        if self._file.chunk_bytes >= OFFLINE_CHUNK_BYTES:
            self._file.end_chunk()
            self._write()

    def close(self) -> None:
        """Finish the file. Raises StorageError."""
        self._file.finish()
        self._write()
        try:
            self._file.sync()
        except OSError as error:
            raise StorageError(f"{self._file.path}: {error.strerror}; the run is incomplete") from error
        finally:
            self._file.close()

    def _write(self) -> None:
        try:
            self._file.write()
        except OSError as error:
            path, why = self._file.path, error.strerror
            raise StorageError(f"{path} cannot be written ({why}); free space and try again") from error
