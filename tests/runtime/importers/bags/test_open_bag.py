"""Recordings of ROS made to hurt: each is a run, or one sentence, in little memory."""

import bz2
import sqlite3
import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard
from lz4.frame import compress as lz4

from runtime.errors import DataSetError
from runtime.importers.bags.message import LARGEST_CHUNK, MOST_TOPICS
from runtime.importers.data_set import import_data_set
from tests.support.runtime.bags import (
    ODOMETRY,
    SCAN,
    START_NS,
    TRANSFORMS,
    Made,
    Message,
    room_drive,
    write_bag1,
    write_bag2,
    write_mcap,
)

MB = 1 << 20
ROS1, ROS2 = Made(True), Made(False)
HEAD = b"\x89MCAP0\r\n"


def record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


def mcap_chunk(packed: bytes, size: int, packing: str) -> bytes:
    return record(6, struct.pack("<QQQI", 0, 0, size, 0) + text(packing) + struct.pack("<Q", len(packed)) + packed)


def field(name: bytes, value: bytes) -> bytes:
    return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value


def record1(fields: bytes, data: bytes) -> bytes:
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def database(path: Path, *statements: str) -> bytes:
    with closing(sqlite3.connect(path)) as connection:
        for statement in (
            "CREATE TABLE topics (id, name, type)",
            "INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan')",
            *statements,
        ):
            connection.execute(statement)
        connection.commit()
    return path.read_bytes()


def zeros(size: int) -> bytes:
    return zstandard.compress(bytes(size))


ROWS = "CREATE TABLE messages (topic_id, timestamp, data)"
MANY = "WITH RECURSIVE row (x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM row WHERE x < 5000)"
BOMB = bytes(LARGEST_CHUNK + 2)
NAMED = record1(
    field(b"op", b"\x07") + field(b"conn", bytes(4)) + field(b"topic", b"/scan"), field(b"type", SCAN.encode())
)
FILES: dict[str, bytes] = {
    "a.mcap whose chunk is a bomb": HEAD + mcap_chunk(zeros(LARGEST_CHUNK), LARGEST_CHUNK, "zstd"),
    "b.mcap whose chunk unpacks to more than it says": HEAD + mcap_chunk(zeros(300 * MB), 1000, "zstd"),
    "c.mcap of many chunks that are bombs": HEAD + mcap_chunk(zeros(3 * MB), 3 * MB, "zstd") * 2000,
    "d.mcap whose chunk of lz4 is a bomb": HEAD + mcap_chunk(lz4(BOMB), 1000, "lz4"),
    "e.mcap with a record of 2**64 bytes": HEAD + record(1, b"") + b"\x09" + b"\xff" * 8,
    "f.mcap with a chunk of 2**63 bytes": HEAD + b"\x06" + struct.pack("<Q", 1 << 63),
    "g.mcap of too many topics": HEAD
    + b"".join(record(4, struct.pack("<HH", k, 0) + text(f"/{k}") + text("cdr")) for k in range(MOST_TOPICS + 2)),
    "h.mcap of a topic without end": HEAD + record(4, bytes(4) + text("/" + "t" * MB) + text("cdr")),
    "i.bag whose chunk of bz2 is a bomb": b"#ROSBAG V2.0\n"
    + record1(field(b"op", b"\x05") + field(b"compression", b"bz2"), bz2.compress(BOMB)),
    "j.bag whose chunk of lz4 is a bomb": b"#ROSBAG V2.0\n"
    + record1(field(b"op", b"\x05") + field(b"compression", b"lz4"), lz4(BOMB)),
    "k.bag whose first line does not end": b"#ROSBAG V2.0" + bytes(MB),
    "l.bag with a header of 4 GB": b"#ROSBAG V2.0\n" + NAMED + b"\xff" * 100,
    "m.db3.zstd that is a bomb": zeros(300 * MB),
    "n.mcap.zstd that is none": zstandard.compress(b"no recording"),
}


def refused_in_little_memory(source: Path, run: Path, most_mb: float = 40.0) -> str:
    tracemalloc.start()
    try:
        with pytest.raises(DataSetError) as caught:
            import_data_set(source, run)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < most_mb * MB, f"{peak / MB:.0f} MB"
    assert "\n" not in str(caught.value)
    assert not run.exists()
    return str(caught.value)


@pytest.mark.parametrize("name", FILES)
def test_what_unpacks_or_says_too_much_is_refused_in_little_memory(tmp_path: Path, name: str) -> None:
    path = tmp_path / name.split()[0]
    path.write_bytes(FILES[name])
    # what is read in pieces is bounded by a chunk, and by its copy in the stream
    assert len(refused_in_little_memory(path, tmp_path / "run", 140.0)) < 600


ODD_ROWS: dict[str, tuple[str, ...]] = {
    "a number for the bytes of a message": (ROWS, "INSERT INTO messages VALUES (1, 5, 3000000000)"),
    "a text for the time": (ROWS, "INSERT INTO messages VALUES (1, 'x', x'00')"),
    "a column that is computed": (
        "CREATE TABLE messages (topic_id, timestamp, data AS (zeroblob(16000000)))",
        f"INSERT INTO messages {MANY} SELECT 1, x FROM row",  # noqa: S608 nothing foreign
    ),
    "a virtual table": ("CREATE VIRTUAL TABLE messages USING fts5 (topic_id, timestamp, data)",),
    "a topic without a name": (ROWS, "INSERT INTO topics VALUES (2, NULL, 7)"),
    "topics without end": (
        ROWS,
        f"INSERT INTO topics {MANY} SELECT x, 'a' || x, 'c' FROM row",  # noqa: S608 nothing foreign
    ),
}


@pytest.mark.parametrize("name", ODD_ROWS)
def test_tables_that_no_recorder_writes_are_refused(tmp_path: Path, name: str) -> None:
    database(tmp_path / "a.db3", *ODD_ROWS[name])
    refused_in_little_memory(tmp_path / "a.db3", tmp_path / "run")


def test_metadata_of_a_bag_is_not_even_read(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag", room_drive(ROS2), "mcap")
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"] + [
        f"{'abcdefghijklmnop'[k]}: &{'abcdefghijklmnop'[k]} [{', '.join(['*' + 'abcdefghijklmnop'[k - 1]] * 9)}]"
        for k in range(1, 16)
    ]
    (bag / "metadata.yaml").write_text("\n".join([*lines, "rosbag2_bagfile_information: {version: *p}"]))
    assert import_data_set(bag, tmp_path / "run")["scans"] == 30


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_files_compressed_by_rosbag_2_are_read(tmp_path: Path, storage: str) -> None:
    bag = write_bag2(tmp_path / "bag", room_drive(ROS2), storage)
    for path in [each for each in bag.iterdir() if each.suffix in (".db3", ".mcap")]:
        path.with_name(f"{path.name}.zstd").write_bytes(zstandard.compress(path.read_bytes()))
        path.unlink()
    result = import_data_set(bag, tmp_path / "run")
    assert (result["scans"], result["wheel_samples"], result["warnings"]) == (30, 30, [])


def test_messages_compressed_by_rosbag_2_are_read(tmp_path: Path) -> None:
    bag = write_bag2(tmp_path / "bag", room_drive(ROS2), "sqlite3")
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as connection:
        for number, data in connection.execute("SELECT rowid, data FROM messages").fetchall():
            connection.execute("UPDATE messages SET data = ? WHERE rowid = ?", (zstandard.compress(data), number))
        connection.commit()
    assert import_data_set(bag, tmp_path / "run")["scans"] == 30


def test_the_tenth_file_of_a_bag_comes_after_the_ninth(tmp_path: Path) -> None:
    messages = list(room_drive(ROS2, 12))
    (tmp_path / "bag").mkdir()
    for k in range(12):
        write_mcap(tmp_path / "bag" / f"yard_{k}.mcap", iter(messages if k == 0 else messages[2 * k + 1 : 2 * k + 3]))
    result = import_data_set(tmp_path / "bag", tmp_path / "run")
    assert result["scans"] == 12


def one_long(made: Made, beams: int) -> Iterator[Message]:
    yield "/scan", SCAN, START_NS, made.scan(START_NS, [1.0] * beams, 0.0, 1e-5)
    for k in range(1, 3000):
        stamp_ns = START_NS + k * 10_000_000
        yield "/scan", SCAN, stamp_ns, made.scan(stamp_ns, [1.0, 2.0], 0.0, 0.1)


def test_one_scan_of_many_beams_among_short_ones_does_not_fill_the_memory(tmp_path: Path) -> None:
    said = refused_in_little_memory(write_mcap(tmp_path / "a.mcap", one_long(ROS2, 32768)), tmp_path / "run")
    assert "2 to 32768 beams" in said


def test_a_scan_of_more_beams_than_any_laser_has_is_left_out(tmp_path: Path) -> None:
    source = write_bag1(tmp_path / "a.bag", one_long(ROS1, 32769))
    result = import_data_set(source, tmp_path / "run", at_rest=True)
    assert result["scans"] == 2999
    assert any("more than 32768 beams" in note for note in result["notes"])


@pytest.mark.parametrize("kind", [SCAN, ODOMETRY, TRANSFORMS])
def test_a_bag_says_only_some_of_its_many_topics(tmp_path: Path, kind: str) -> None:
    content = {
        SCAN: ROS2.scan(0, [], 0.0, 0.1),
        ODOMETRY: ROS2.odometry(0, 0.0, 0.0, 0.0),
        TRANSFORMS: ROS2.transforms(0),
    }
    messages = ((f"/t{k:03d}", kind, START_NS, content[kind]) for k in range(300))
    assert "and 260 more" in refused_in_little_memory(write_mcap(tmp_path / "a.mcap", messages), tmp_path / "run")


def test_any_length_in_an_mcap_file_is_survived(tmp_path: Path) -> None:
    whole = write_mcap(tmp_path / "whole.mcap", room_drive(ROS2, 3), chunk_bytes=2000).read_bytes()
    rng = np.random.default_rng(3)
    for trial in range(60):
        odd = bytearray(whole)
        at = int(rng.integers(8, len(odd) - 8))
        odd[at : at + 8] = struct.pack("<Q", int(rng.choice([0, 1 << 31, 1 << 32, (1 << 63) - 1, 1 << 63])))
        (tmp_path / "a.mcap").write_bytes(odd)
        try:
            import_data_set(tmp_path / "a.mcap", tmp_path / f"run{trial}")
        except DataSetError as error:
            assert "\n" not in str(error)  # noqa: PT017 either outcome will do
