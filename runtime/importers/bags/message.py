"""What every recording of ROS gives, and what reading a damaged one raises."""

import sqlite3
import struct
import zlib
from collections.abc import Collection, Iterator
from typing import NamedTuple, Protocol

import zstandard

LARGEST_RECORD = 1 << 24  # bytes of a message, also unpacked: a scan of 32768 beams has 256 kB
LARGEST_CHUNK = 1 << 26  # unpacked; recorders close a chunk at 768 kB, or after the message that goes beyond
MOST_TOPICS = 4096
LONGEST_NAME = 256
BROKEN = (
    *(sqlite3.Error, struct.error, zlib.error, zstandard.ZstdError, ArithmeticError, LookupError, EOFError, OSError),
    *(MemoryError, ValueError, TypeError, AttributeError, RuntimeError, AssertionError),
)
"""What the libraries raise on bytes that are damaged or end early."""


class BagMessage(NamedTuple):
    """One message as it stands in the file. log_ns: when it was recorded; is_ros1: not in CDR but as ROS 1 had it."""

    topic: str
    log_ns: int
    data: bytes
    is_ros1: bool


class Bag(Protocol):
    """topics: name to type, such as sensor_msgs/msg/LaserScan. damage: why reading ended early, known at the end.
    size_bytes: of its files.
    """

    topics: dict[str, str]
    damage: str
    size_bytes: int

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """All messages of these topics in the order of recording."""


def note_topic(topics: dict[str, str], name: str, type_name: str) -> None:
    """Keep a topic, its type sensor_msgs/LaserScan of ROS 1 as sensor_msgs/msg/LaserScan. Raises ValueError where it
    has no name, or where there are too many.
    """
    if not (isinstance(name, str) and isinstance(type_name, str) and max(len(name), len(type_name)) <= LONGEST_NAME):
        raise ValueError(f"a topic or its type has no name of up to {LONGEST_NAME} characters")
    package, _, kind = type_name.partition("/")
    topics[name] = type_name if "/msg/" in type_name or not kind else f"{package}/msg/{kind}"
    if len(topics) > MOST_TOPICS:
        raise ValueError(f"more than {MOST_TOPICS} topics")
