"""A recorded data set as arrays with a description (format ld2d-1), and how it is read from an .npz file."""

import json
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.bounded_read import open_regular, read_bounded
from runtime.errors import DataSetError
from runtime.evaluate.truth import ENCRYPTED, PACKINGS, UNREADABLE
from runtime.importers.parsing.checks import KNOWN, checked
from runtime.importers.parsing.inflation import Inflation
from runtime.importers.parsing.left_out import LeftOut
from runtime.messages.tick import Record

LARGEST_BYTES = 1 << 32  # of all arrays together; a day of a fast laser has a tenth
FREE_BYTES, MOST_TIMES = 1 << 26, 16  # of all arrays: so many, or so many times the size of the file; 7 times was seen
FREE_ROWS, PACKED_BYTES_A_ROW = 100_000, 8  # rows with a time, each a value of its own in memory; 18 bytes were seen
FREE_BEAMS, BEAMS_A_PACKED_BYTE = 12_500_000, 2  # twelve bytes of memory each; 1.6 beams in a byte were seen
END_OF_DIRECTORY, LONGEST_END, LARGEST_DIRECTORY = b"PK\5\6", 1 << 16, 1 << 18  # of zip
LARGEST_META = 1 << 20
NO_NUMBERS = (ValueError, SyntaxError, TokenError, RecursionError, MemoryError, TypeError, ArithmeticError)
"""What numpy raises on an array that is none: its head is read by the parser of Python."""
META = "meta"
SHOWN = 6  # names of a folder's files in a message


@dataclass(frozen=True, slots=True)
class Archive:
    """Arrays by name; those that a set does not have are absent. meta: its description.

    left_out: what its reader could not use. laser_latency_s: taken off the stamps of what was seen. raw: of a capture
    of wires, its bytes as records with stamps since the set's start, which it is told; None for other sets.
    """

    name: str
    path: Path
    arrays: dict[str, NDArray[Any]]
    meta: dict[str, Any]
    left_out: LeftOut = field(default_factory=LeftOut)
    laser_latency_s: float = 0.0
    raw: Callable[[int], Iterator[Record]] | None = None

    def __contains__(self, name: str) -> bool:
        return name in self.arrays

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    @property
    def start_s(self) -> float:
        """Earliest time of anything in the set, in its own seconds: zero of the run's stamps."""
        firsts = [
            float(self.arrays[name][0]) - self._late_s(name)
            for name in ("scan_t", "odom_t", "obs_t", "gt_t")
            if name in self.arrays and self.arrays[name].size
        ]
        return min(firsts, default=0.0)

    def stamps_ns(self, name: str) -> list[int]:
        """Times of an array as nanoseconds since the set's start; those of scans and sightings without latency."""
        offsets_s = self.arrays[name].astype(np.float64) - self._late_s(name) - self.start_s
        stamps: list[int] = np.round(offsets_s * 1e9).astype(np.int64).tolist()
        return stamps

    def _late_s(self, name: str) -> float:
        return self.laser_latency_s if name in ("scan_t", "obs_t") else 0.0


def load_archive(source: Path) -> Archive:
    """Read FOLDER/FOLDER.npz, or the .npz itself, with the meta.json beside it where there is one.

    Raises DataSetError with one sentence when it is not there, not an archive, lacks a description, or when one of its
    arrays has not the form that it must have.
    """
    path = source / f"{source.name}.npz" if source.is_dir() else source
    if source.is_dir() and not path.is_file() and len(found := sorted(source.glob("*.npz"))) == 1:
        path = found[0]
    if not path.is_file():
        there = ", ".join(sorted(each.name for each in source.iterdir())[:SHOWN]) if source.is_dir() else ""
        raise DataSetError(
            f"{source} holds no {path.name}{f'; it holds {there}' if there else ''}; give the folder of a data set, or "
            "the file of the recording"
        )
    try:
        arrays = _arrays(path)
    except UNREADABLE as error:
        raise DataSetError(f"{path} cannot be read as a data set ({error}); fetch it again") from error
    _check_room(path, arrays)
    meta = _meta(path, arrays.pop(META, None))
    left_out = LeftOut()
    return Archive(str(meta.get("name", path.stem)), path, checked(path, arrays, meta, left_out), meta, left_out)


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The members that a data set can have. Raises DataSetError, and whatever a file that is no archive makes numpy
    raise.
    """
    _check_directory(path)
    with zipfile.ZipFile(path) as members:  # numpy would take what is none for a pickle, and say so
        items = members.infolist()
    sizes = {item.filename.removesuffix(".npy"): item.file_size for item in items}
    if len(sizes) < len(items) or any(
        item.compress_type not in PACKINGS or item.flag_bits & ENCRYPTED for item in items
    ):
        raise DataSetError(f"{path} has a duplicate name, or was not packed by numpy; save it again with numpy.savez")
    size = sum(size for name, size in sizes.items() if name in KNOWN)
    packed = path.stat().st_size
    most = min(LARGEST_BYTES, Inflation(packed).left, max(FREE_BYTES, MOST_TIMES * packed))
    if size > most:
        raise DataSetError(f"{path} unpacks to {size / 1e6:.0f} MB, expected at most {most / 1e6:.0f} MB")
    if sizes.get(META, 0) > LARGEST_META:
        raise DataSetError(f"{path}: array {META} has {sizes[META]} bytes, a description has at most {LARGEST_META}")
    arrays = {}
    with np.load(path, allow_pickle=False) as archive:
        for name in (name for name in archive.files if name in KNOWN or name == META):
            try:
                arrays[name] = archive[name]
            except NO_NUMBERS as error:
                raise DataSetError(
                    f"{path}: array {name} cannot be read; expected plain numbers as numpy.savez writes them"
                ) from error
    return {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)}


def _check_room(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Raises DataSetError for rows and beams of which far more come out of a file than a recording has."""
    packed = path.stat().st_size
    rows = sum(array.shape[0] for name, array in arrays.items() if name.endswith("_t") and array.ndim)
    beams = arrays["ranges"].size if "ranges" in arrays else 0
    for what, count, most in (
        ("rows with a time", rows, FREE_ROWS + packed // PACKED_BYTES_A_ROW),
        ("beams", beams, max(FREE_BEAMS, BEAMS_A_PACKED_BYTE * packed)),
    ):
        if count > most:
            raise DataSetError(
                f"{path} holds {count} {what}, expected at most {most} in {packed} bytes; split the recording"
            )


def _check_directory(path: Path) -> None:
    """Raises BadZipFile for a list of contents so long that reading it would fill the memory."""
    with open_regular(path) as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - LONGEST_END))
        end = stream.read()
    at = end.rfind(END_OF_DIRECTORY)
    if at >= 0 and len(end) >= at + 16 and int.from_bytes(end[at + 12 : at + 16], "little") > LARGEST_DIRECTORY:
        raise zipfile.BadZipFile(f"its list of contents is longer than {LARGEST_DIRECTORY} bytes")


def _meta(path: Path, member: NDArray[Any] | None) -> dict[str, Any]:
    """The description: that inside the archive, and over it the one that a person can edit beside it."""
    texts = {} if member is None else {f"{path}: array {META}": str(member)}
    beside = path.with_name("meta.json")
    if beside.is_file():
        try:
            texts[str(beside)] = read_bounded(beside, LARGEST_META).decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise DataSetError(f"{beside} cannot be read ({error}); save it as UTF-8 text") from error
    if not texts:
        raise DataSetError(f"{path} has no array named meta; it must describe the sensor (format ld2d-1)")
    meta: dict[str, Any] = {}
    for place, text in texts.items():
        try:
            told = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise DataSetError(f"{place} is not valid JSON ({error}); correct it, or leave it out") from error
        if not isinstance(told, dict):
            raise DataSetError(f'{place} is {text[:40]!r}, expected a JSON object such as {{"name": "yard"}}')
        meta |= told
    return meta
