"""Messages out of recordings of ROS: rosbag 1, rosbag 2 (SQLite or MCAP), and single .mcap or .db3 files.

A recorder that was killed leaves a file without index and a folder without metadata.yaml; both are read up to where
they end.
"""

import bz2
import sqlite3
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import ReaderError as Reader1Error
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import ReaderError as Reader2Error

from runtime.errors import DataSetError

ROSBAG1 = b"#ROSBAG V2.0"
MCAP = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"
METADATA = "metadata.yaml"
LOOSE = (".mcap", ".db3")
MESSAGE, CHUNK, CONNECTION = b"\x02", b"\x05", b"\x07"  # kinds of records of a rosbag 1
LARGEST_RECORD = 1 << 26  # bytes, also unpacked; recorders close a chunk at 768 kB
BROKEN = (
    *(McapError, Reader1Error, Reader2Error, sqlite3.Error, struct.error, zlib.error, zstandard.ZstdError),
    *(OSError, EOFError, MemoryError, ValueError, KeyError, IndexError, RuntimeError, AssertionError),
)
"""What the libraries raise on a file that is damaged or ends early."""


class BagMessage(NamedTuple):
    """One message as it stands in the file. log_ns: when it was recorded; is_ros1: not in CDR but as ROS 1 had it."""

    topic: str
    log_ns: int
    data: bytes
    is_ros1: bool


class Bag(Protocol):
    """topics: name to type, such as sensor_msgs/msg/LaserScan. damage: why reading ended early, known at the end."""

    topics: dict[str, str]
    damage: str

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """All messages of these topics in the order of recording."""


def is_bag(source: Path, head: bytes) -> bool:
    """Whether a source is a recording of ROS; head: its first bytes, b"" for a folder."""
    if source.is_dir():
        return (source / METADATA).is_file() or (bool(_loose_files(source)) and not any(source.glob("*.npz")))
    return head.startswith((ROSBAG1, MCAP, SQLITE))


def open_bag(source: Path, head: bytes) -> Bag:
    """The recording with its topics. Raises DataSetError where not even these can be read."""
    try:
        if source.is_dir() and not (source / METADATA).is_file():
            return LooseBag(_loose_files(source))
        return IndexedBag(source) if source.is_dir() or head.startswith(ROSBAG1) else LooseBag([source])
    except BROKEN as error:
        if head.startswith(ROSBAG1) and (torn := TornBag1(source, f"its index cannot be used ({error})")).topics:
            return torn
        if files := _loose_files(source) if source.is_dir() else []:
            bag = LooseBag(files)
            bag.damage = f"{METADATA} or the index of the bag cannot be used ({error})"
            return bag
        raise DataSetError(f"{source} cannot be read as a bag ({error}); record it again or fetch it again") from error


class IndexedBag:
    """A whole rosbag 1 file, or a rosbag 2 folder with its metadata, as the library rosbags reads them."""

    def __init__(self, source: Path) -> None:
        self.damage = ""
        self._is_ros1 = source.is_file()
        for path in () if self._is_ros1 else source.glob("*.db3"):
            with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
                _check_tables(database)
        self._reader: Any = Reader1(source) if self._is_ros1 else Reader2(source)
        with self._reader:
            self.topics = {connection.topic: connection.msgtype for connection in self._reader.connections}

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """See Bag."""
        try:
            with self._reader:
                chosen = [each for each in self._reader.connections if each.topic in topics]
                for connection, log_ns, data in self._reader.messages(connections=chosen) if chosen else ():
                    yield BagMessage(connection.topic, log_ns, bytes(data), self._is_ros1)
        except BROKEN as error:
            self.damage = f"the bag is damaged ({error})"


class LooseBag:
    """Single files of rosbag 2 without an index or a description; MCAP of ROS 1 too."""

    def __init__(self, files: list[Path]) -> None:
        self.damage = ""
        self.topics: dict[str, str] = {}
        self._files = files
        for _ in self.messages(()):
            pass

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """See Bag."""
        for path in self._files:
            try:
                yield from (self._of_sqlite if _first_bytes(path).startswith(SQLITE) else self._of_mcap)(path, topics)
            except BROKEN as error:
                self.damage = f"{path.name} ends early or is damaged ({error or type(error).__name__})"

    def _of_mcap(self, path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, bool]] = {}
        with path.open("rb") as stream:
            for record in StreamReader(stream, record_size_limit=path.stat().st_size).records:
                match record:
                    case Schema():
                        schemas[record.id] = normalised(record.name)
                    case Channel():
                        channels[record.id] = (record.topic, record.message_encoding == "ros1")
                        self.topics[record.topic] = schemas.get(record.schema_id, "")
                    case Message() if record.channel_id in channels:
                        topic, is_ros1 = channels[record.channel_id]
                        if topic in topics:
                            yield BagMessage(topic, record.log_time, record.data, is_ros1)

    def _of_sqlite(self, path: Path, topics: Collection[str]) -> Iterator[BagMessage]:
        begun = path.with_name(f"{path.name}-wal").exists()  # else nothing but the file counts, in any folder
        address = f"{path.resolve().as_uri()}?mode=ro{'' if begun else '&immutable=1'}"
        with closing(sqlite3.connect(address, uri=True)) as database:
            _check_tables(database)
            rows = database.execute("SELECT id, name, type FROM topics").fetchall()
            names = {number: name for number, name, _ in rows}
            self.topics |= {name: normalised(kind) for _, name, kind in rows}
            wanted = [number for number, name in names.items() if name in topics]
            marks = ",".join("?" * len(wanted))
            # marks is nothing but question marks
            order = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp"  # noqa: S608
            for number, log_ns, data in database.execute(order, wanted):
                yield BagMessage(names[number], int(log_ns), bytes(data), False)


class TornBag1:
    """A rosbag 1 file without an index that can be used, record by record, as `rosbag reindex` reads it."""

    def __init__(self, source: Path, damage: str) -> None:
        self.damage = damage
        self.topics: dict[str, str] = {}
        self._source = source
        self._names: dict[bytes, str] = {}
        for _ in self.messages(()):
            pass

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """See Bag."""
        with self._source.open("rb") as stream:
            stream.readline()
            for fields, data in _records1(stream):
                for inner, content in _records1(BytesIO(_unpacked(fields, data))) if fields["op"] == CHUNK else ():
                    yield from self._message(inner, content, topics)
                yield from self._message(fields, data, topics)

    def _message(self, fields: dict[str, bytes], data: bytes, topics: Collection[str]) -> Iterator[BagMessage]:
        number = fields.get("conn", b"")
        if fields["op"] == CONNECTION:
            topic = fields.get("topic", b"").decode("utf-8", "replace")
            self._names[number] = topic
            self.topics[topic] = normalised(_fields1(data).get("type", b"").decode("latin-1"))
        elif fields["op"] == MESSAGE and self._names.get(number) in topics and len(fields.get("time", b"")) == 8:
            seconds, nanoseconds = struct.unpack("<II", fields["time"])
            yield BagMessage(self._names[number], seconds * 1_000_000_000 + nanoseconds, data, True)


def _records1(stream: BinaryIO) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """(fields of the header, data) of the whole records of a rosbag 1; a chunk that is cut off is given as it is."""
    while len(size := stream.read(4)) == 4:
        header = stream.read(min(int.from_bytes(size, "little"), LARGEST_RECORD))
        fields, length = _fields1(header), int.from_bytes(stream.read(4), "little")
        data = stream.read(min(length, LARGEST_RECORD))
        if "op" not in fields or (len(data) < length and fields["op"] != CHUNK):
            return
        yield fields, data


def _fields1(header: bytes) -> dict[str, bytes]:
    """The name=value pairs of a header."""
    fields, at = {}, 0
    while at + 4 <= len(header):
        length = int.from_bytes(header[at : at + 4], "little")
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        fields[name.decode("latin-1")] = value
        at += 4 + length
    return fields


def _unpacked(fields: dict[str, bytes], data: bytes) -> bytes:
    """What a chunk holds; nothing where it is damaged or unpacks to more than a record may have."""
    try:
        match fields.get("compression"):
            case b"bz2":
                return bz2.BZ2Decompressor().decompress(data, LARGEST_RECORD)
            case b"lz4":
                return bytes(LZ4FrameDecompressor().decompress(data, LARGEST_RECORD))
            case _:
                return data
    except BROKEN:
        return b""


def normalised(type_name: str) -> str:
    """sensor_msgs/LaserScan of ROS 1 as sensor_msgs/msg/LaserScan."""
    package, _, name = type_name.partition("/")
    return type_name if "/msg/" in type_name or not name else f"{package}/msg/{name}"


def _check_tables(database: sqlite3.Connection) -> None:
    """Raises ValueError where what is read are views, which may have rows without end; bounds what a row may hold."""
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_RECORD)
    kinds = dict(database.execute("SELECT name, type FROM sqlite_master WHERE name IN ('topics', 'messages')"))
    if kinds != {"topics": "table", "messages": "table"}:
        raise ValueError("topics and messages are not two tables")


def _loose_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix in LOOSE and path.is_file())


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(len(SQLITE))
