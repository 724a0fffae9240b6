"""Which format a recording is in, by what it holds and not by its name."""

from pathlib import Path

from runtime.errors import DataSetError
from runtime.importers.archive import Archive, load_archive
from runtime.importers.carmen import WORDS, load_carmen
from runtime.importers.parsing.bag_files import is_bag
from runtime.importers.parsing.text_lines import TextLines
from runtime.importers.rosbag import Topics, load_rosbag

LOOKED_AT = 2000  # lines of a text log until one tells what it is
HEAD_BYTES = 64
ZIP = b"PK\x03\x04"
SOURCES = "a folder or .npz of arrays, a bag of ROS 1 or 2 (.bag, .mcap, .db3, or its folder), a CARMEN log (also .gz)"


def load(source: Path, topics: Topics) -> Archive:
    """Read a recording. Raises DataSetError with one sentence that says what a source may be."""
    head = _head(source)
    if is_bag(source, head):
        return load_rosbag(source, head, topics)
    if source.is_dir() or source.suffix == ".npz" or not source.is_file() or head.startswith(ZIP):
        return load_archive(source)
    if _first_word(source) in WORDS:
        return load_carmen(source)
    raise DataSetError(f"{source} is none of the recordings that can be read: {SOURCES}; see docs/data_sets.md")


def _first_word(source: Path) -> str:
    """The first word of a text log that says what it is; "" where none does."""
    for number, line, _ in TextLines(source):
        word = (line.split(maxsplit=1) or [""])[0]
        if word in WORDS:
            return word
        if number > LOOKED_AT:
            break
    return ""


def _head(source: Path) -> bytes:
    if not source.is_file():
        return b""
    try:
        with source.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except OSError as error:
        raise DataSetError(f"{source} cannot be read ({error.strerror}); check the path") from error
