"""Which format a recording is in, by what it holds and not by its name."""

from pathlib import Path

from runtime.errors import DataSetError
from runtime.importers.archive import Archive, load_archive
from runtime.importers.carmen import WORDS, load_carmen
from runtime.importers.parsing.text_lines import TextLines

LOOKED_AT = 2000  # lines of a text log until one tells what it is
ZIP = b"PK\x03\x04"
SOURCES = "a folder or .npz of arrays, a CARMEN log (also .gz)"


def load(source: Path) -> Archive:
    """Read a recording. Raises DataSetError with one sentence that says what a source may be."""
    if source.is_dir() or source.suffix == ".npz" or not source.is_file() or _head(source) == ZIP:
        return load_archive(source)
    if is_carmen(source):
        return load_carmen(source)
    raise DataSetError(f"{source} is none of the recordings that can be read: {SOURCES}; see docs/data_sets.md")


def is_carmen(source: Path) -> bool:
    """Whether a line of a CARMEN log stands near the head of a file."""
    try:
        for number, line, _ in TextLines(source):
            if line.split(maxsplit=1)[:1] and line.split(maxsplit=1)[0] in WORDS:
                return True
            if number > LOOKED_AT:
                break
    except OSError as error:
        raise DataSetError(f"{source} cannot be read ({error.strerror}); check the path") from error
    return False


def _head(source: Path) -> bytes:
    try:
        with source.open("rb") as stream:
            return stream.read(len(ZIP))
    except OSError as error:
        raise DataSetError(f"{source} cannot be read ({error.strerror}); check the path") from error
