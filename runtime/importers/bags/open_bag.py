"""A recording of ROS by what it holds: rosbag 1, or files of rosbag 2, alone or in a folder.

metadata.yaml is not read: all that it tells stands in the files too, and a recorder that was killed does not write it.
"""

import re
from pathlib import Path

from runtime.errors import DataSetError
from runtime.importers.bags.mcap_records import MAGIC
from runtime.importers.bags.message import BROKEN, Bag
from runtime.importers.bags.rosbag1 import ROSBAG1, Bag1
from runtime.importers.bags.rosbag2 import SQLITE, ZSTD, Bag2

METADATA = "metadata.yaml"
BAG_FILE = re.compile(r".*?(\d*)\.(?:mcap|db3)(?:\.zstd)?")
MOST_FILES = 10_000


def is_bag(source: Path, head: bytes) -> bool:
    """Whether a source is a recording of ROS; head: its first bytes, b"" for a folder."""
    if source.is_dir():
        return (source / METADATA).is_file() or (bool(_bag_files(source)) and not any(source.glob("*.npz")))
    return head.startswith((ROSBAG1, MAGIC, SQLITE)) or (
        head.startswith(ZSTD) and bool(BAG_FILE.fullmatch(source.name))
    )


def open_bag(source: Path, head: bytes) -> Bag:
    """The recording with its topics. Raises DataSetError where not even these can be read."""
    try:
        bag: Bag1 | Bag2 = Bag1(source) if head.startswith(ROSBAG1) else Bag2(_files(source))
    except BROKEN as error:
        why = str(error) or type(error).__name__
        raise DataSetError(f"{source} cannot be read as a bag ({why}); record it again or fetch it again") from error
    if not bag.topics:
        why = bag.damage or "it has no topic"
        raise DataSetError(f"{source} cannot be read as a bag ({why}); record it again or fetch it again")
    return bag


def _files(source: Path) -> list[Path]:
    if not source.is_dir():
        return [source]
    if not (files := _bag_files(source)):
        raise ValueError("it holds no .mcap and no .db3 file")
    return files


def _bag_files(folder: Path) -> list[Path]:
    """In the order of recording: yard_9.db3 before yard_10.db3."""
    found = [(match, path) for path in folder.iterdir() if (match := BAG_FILE.fullmatch(path.name)) and path.is_file()]
    if len(found) > MOST_FILES:
        raise DataSetError(f"{folder} holds {len(found)} files of bags; give a folder of at most {MOST_FILES}")
    return [path for _, path in sorted(found, key=lambda each: (int(each[0][1][-18:] or 0), each[1].name))]
