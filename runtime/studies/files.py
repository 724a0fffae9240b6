"""Figures as files: CSV, JSON and text, each written whole or not at all."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runtime.atomic_write import atomic_write
from runtime.errors import StorageError

Row = dict[str, Any]


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """A CSV file; columns are the keys in the order of their first use. Raises StorageError."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, names)
    writer.writeheader()
    writer.writerows(rows)
    write(path, stream.getvalue())


def write_json(path: Path, content: Any) -> None:
    """One JSON file. Raises StorageError."""
    write(path, json.dumps(content, indent=1) + "\n")


def write_text(path: Path, lines: Sequence[str]) -> None:
    """One text file. Raises StorageError."""
    write(path, "\n".join(lines) + "\n")


def write(path: Path, text: str) -> None:
    """A file whole or not at all. Raises StorageError."""
    try:
        atomic_write(path, text)
    except OSError as error:
        raise StorageError(f"{path}: cannot be written ({error.strerror}); choose another --out") from error
