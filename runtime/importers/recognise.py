"""Which format a recording is in, by what it holds and not by its name."""

from pathlib import Path

from runtime.bounded_read import open_regular
from runtime.errors import DataSetError, UsageError
from runtime.importers.archive import Archive, load_archive
from runtime.importers.bags.open_bag import is_bag
from runtime.importers.carmen import WORDS, load_carmen
from runtime.importers.parsing.candump_lines import candump_line
from runtime.importers.parsing.scip_capture import is_scip
from runtime.importers.parsing.text_lines import TextLines
from runtime.importers.rosbag import Topics, load_rosbag
from runtime.importers.wire_captures import joined, load_candump, load_scip
from runtime.settings.configuration import load_configuration
from runtime.source_tree import CONFIG

LOOKED_AT = 2000  # lines of a text log until one tells what it is
HEAD_BYTES = 4096
ZIP = b"PK\x03\x04"
SOURCES = (
    "a folder or .npz of arrays, a bag of ROS 1 or 2 (.bag, .mcap, .db3, or its folder), a CARMEN log, a candump log "
    "(both also .gz), a capture of SCIP bytes, or a folder with such a log and such a capture"
)


def load(source: Path, topics: Topics, config: Path | None) -> Archive:
    """Read a recording. config: says which frames of a candump are the wheels'; None: those of config/rover.toml.

    Raises DataSetError with one sentence that says what a source may be, ConfigurationError; UsageError for topics of
    what is no bag.
    """
    try:
        return _load(source, topics, config)
    except OSError as error:
        raise DataSetError(f"{source} cannot be read ({error.strerror}); check the path and its permissions") from error


def _load(source: Path, topics: Topics, config: Path | None) -> Archive:
    if not source.is_dir() and not source.is_file():
        what = "is neither a file nor a folder" if source.exists() else "does not exist"
        raise DataSetError(f"{source} {what}; give {SOURCES}")
    head = b"" if source.is_dir() else _head(source)
    if is_bag(source, head):
        return load_rosbag(source, head, topics)
    if topics != Topics():
        raise UsageError(
            f"--scan-topic and --odom-topic choose a topic of a ROS bag, which {source} is not: leave them out"
        )
    if source.is_dir() and (wires := _wires(source, config)) is not None:
        return wires
    if source.is_dir() or source.suffix == ".npz" or head.startswith(ZIP):
        return load_archive(source)
    if is_scip(head):
        return load_scip(source)
    first = _first_word(source)
    if first in WORDS:
        return load_carmen(source)
    if first:
        return _candump(source, config)
    raise DataSetError(f"{source} is not a recording that can be imported; expected {SOURCES}; see docs/data_sets.md")


def _candump(source: Path, config: Path | None) -> Archive:
    path = config if config is not None else CONFIG / "rover.toml"
    encoders = load_configuration(path).encoders
    if encoders is None:
        raise DataSetError(
            f"{path} has no table [encoders] that says which frames of {source.name} belong to the "
            "wheels; add it, or start from config/rover.toml"
        )
    return load_candump(source, encoders)


def _wires(folder: Path, config: Path | None) -> Archive | None:
    """What a folder with a capture of SCIP bytes, a candump log, or one of each holds; None where it has neither."""
    files = [path for path in sorted(folder.iterdir())[:LOOKED_AT] if path.is_file() and path.suffix != ".npz"]
    lasers = [path for path in files if is_scip(_head(path))]
    buses = [path for path in files if path not in lasers and _first_word(path) not in ("", *WORDS)]
    for captures, what in ((lasers, "captures of a laser"), (buses, "candump logs")):
        if len(captures) > 1:
            names = f"{captures[0].name} and {captures[1].name}"
            raise DataSetError(
                f"{folder} holds {len(captures)} {what}, such as {names}; give a folder with one of each"
            )
    laser, bus = ([load_scip(path) for path in lasers], [_candump(path, config) for path in buses])
    return joined(laser[0], bus[0], folder) if laser and bus else next(iter(laser + bus), None)


def _first_word(source: Path) -> str:
    """What a text log tells by the first line that it can be known by: a word of CARMEN or the time of a candump."""
    for number, line, _ in TextLines(source):
        word = (line.split(maxsplit=1) or [""])[0]
        if word in WORDS or _is_candump(line):
            return word
        if number > LOOKED_AT:
            break
    return ""


def _is_candump(line: str) -> bool:
    try:
        candump_line(line)
    except ValueError:
        return False
    return True


def _head(source: Path) -> bytes:
    with open_regular(source) as stream:
        return stream.read(HEAD_BYTES)
