"""Files of rosbag 2, SQLite or MCAP, also compressed by zstd; MCAP of ROS 1 too."""

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO, Any

import zstandard

from runtime.bounded_read import open_regular
from runtime.importers.bags.mcap_records import CHANNEL, MESSAGE, SCHEMA, mcap_records, message_of, texts_of
from runtime.importers.bags.message import BROKEN, LARGEST_RECORD, LONGEST_NAME, MOST_TOPICS, BagMessage, note_topic
from runtime.importers.parsing.inflation import Inflation

SQLITE = b"SQLite format 3\0"
ZSTD = b"\x28\xb5\x2f\xfd"
BLOCK_BYTES = 1 << 16
LARGEST_WINDOW = 1 << 27  # that zstd may ask for; its own programs ask for no more
MOST_WANTED = 500  # topics at once; SQLite takes 999 values
MOST_COLUMNS = 100


class Bag2:
    """See Bag. A file that is damaged or ends early is read as far as it goes."""

    def __init__(self, files: list[Path]) -> None:
        self.damage = ""
        self.topics: dict[str, str] = {}
        self._files = files
        self.size_bytes = sum(path.stat().st_size for path in files)
        for _ in self.messages(()):
            pass

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """See Bag."""
        for path in self._files:
            inflation = Inflation(path.stat().st_size)
            try:
                with _opened(path, inflation) as stream:
                    is_sqlite = stream.read(len(SQLITE)) == SQLITE
                    stream.seek(0)
                    read = self._of_sqlite if is_sqlite else self._of_mcap
                    for message in read(stream, topics, inflation):
                        yield message._replace(data=_unpacked(message.data, inflation))
            except BROKEN as error:
                self.damage = f"{path.name} ends early or is damaged ({error or type(error).__name__})"

    def _of_mcap(self, stream: IO[bytes], topics: Collection[str], inflation: Inflation) -> Iterator[BagMessage]:
        schemas: dict[int, str] = {}
        channels: dict[int, tuple[str, bool]] = {}
        for kind, body in mcap_records(stream, inflation):
            if kind == MESSAGE:
                number, log_ns, data = message_of(body)
                topic, is_ros1 = channels.get(number, ("", False))
                if topic in topics:
                    yield BagMessage(topic, log_ns, data, is_ros1)
            elif kind == SCHEMA:
                number, (name,) = texts_of(body, 0, 1)
                schemas[number] = name[: LONGEST_NAME + 1]
            elif kind == CHANNEL:
                number, (topic, encoding) = texts_of(body, 2, 2)
                note_topic(self.topics, topic, schemas.get(int.from_bytes(body[2:4], "little"), ""))
                channels[number] = (topic, encoding == "ros1")

    def _of_sqlite(self, stream: IO[bytes], topics: Collection[str], _inflation: Inflation) -> Iterator[BagMessage]:
        path = Path(stream.name).resolve()
        left_bytes = sum(each.stat().st_size for each in (path, _log_of(path)) if each.exists())
        begun = _log_of(path).exists()  # else nothing but the file counts, in any folder
        address = f"{path.as_uri()}?mode=ro{'' if begun else '&immutable=1'}"
        with closing(sqlite3.connect(address, uri=True)) as database:
            _check_tables(database)
            rows = database.execute("SELECT id, name, type FROM topics").fetchmany(MOST_TOPICS + 1)
            names: dict[Any, str] = {}
            for number, name, kind in rows:
                note_topic(self.topics, name, kind)
                names[number] = name
            wanted = [number for number, name in names.items() if name in topics][:MOST_WANTED]
            marks = ",".join("?" * len(wanted))
            # marks is nothing but question marks
            order = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp"  # noqa: S608
            for number, log_ns, data in database.execute(order, wanted) if wanted else ():
                if not (isinstance(log_ns, int) and isinstance(data, bytes)):
                    raise ValueError("a message does not consist of bytes, or has no time")
                left_bytes -= len(data)
                if left_bytes < 0:
                    raise ValueError("its messages have more bytes than the file")
                yield BagMessage(names[number], log_ns, data, False)


def _log_of(database: Path) -> Path:
    """What SQLite has not yet put into the file."""
    return database.with_name(f"{database.name}-wal")


@contextmanager
def _opened(path: Path, inflation: Inflation) -> Iterator[IO[bytes]]:
    """A file with its name; of one that is compressed, a copy that is not."""
    with open_regular(path) as stream:
        is_packed = stream.read(len(ZSTD)) == ZSTD
        stream.seek(0)
        if not is_packed:
            yield stream
            return
        with NamedTemporaryFile(prefix="infant-") as whole:
            unpacked = zstandard.ZstdDecompressor(max_window_size=LARGEST_WINDOW).stream_reader(
                stream, read_across_frames=True
            )
            while block := unpacked.read(BLOCK_BYTES):
                inflation.take(len(block))
                whole.write(block)
            whole.seek(0)
            yield whole


def _unpacked(data: bytes, inflation: Inflation) -> bytes:
    """A message that was compressed by itself; CDR begins otherwise."""
    if not data.startswith(ZSTD):
        return data
    size = zstandard.frame_content_size(data)
    if not 0 <= size <= LARGEST_RECORD:
        raise ValueError(f"a message that would unpack to {size} bytes")
    inflation.take(size)
    return zstandard.ZstdDecompressor(max_window_size=LARGEST_WINDOW).decompress(data, size)


def _check_tables(database: sqlite3.Connection) -> None:
    """Raises ValueError where what is read are views, virtual tables or computed columns, which may have rows and bytes
    without end; bounds what a row may hold.
    """
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_RECORD)
    database.execute("PRAGMA trusted_schema = OFF")
    kinds = dict(
        database.execute(
            "SELECT name, type FROM sqlite_master WHERE name IN ('topics', 'messages') AND rootpage > 0"
        ).fetchmany(3)
    )
    if kinds != {"topics": "table", "messages": "table"}:
        raise ValueError("topics and messages are not two tables")
    for table in kinds:
        if any(column[-1] for column in database.execute(f"PRAGMA table_xinfo({table})").fetchmany(MOST_COLUMNS)):
            raise ValueError(f"a column of {table} is computed")
