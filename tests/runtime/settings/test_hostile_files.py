"""A configuration of others is refused in few printable words, soon, whatever the file is."""

import os
import time
from pathlib import Path

import pytest

from runtime.errors import ConfigurationError
from runtime.settings.configuration import LARGEST_BYTES, MOST_PROBLEMS, load_configuration, load_configuration_text

CONTENTS: dict[str, bytes] = {
    "twenty thousand unknown keys": b"".join(b"unknown_%d = 1\n" % number for number in range(20_000)),
    "two thousand unknown keys": b"".join(b"unknown_%d = 1\n" % number for number in range(2000)),
    "a number of five thousand digits": b"seed = " + b"9" * 5000,
    "lists in lists": b"seed = " + b"[" * 3000,
    "tables in tables": b"x = " + b"{a=" * 3000,
    "a key of many parts": b"a." * 30_000 + b"a = 1",
    "many keys of many parts": (b"a." * 300 + b"a%d = 1\n") * 100,
    "a table within the limit of the library": b".".join([b"a"] * 40) + b" = 1",
    "no text": b"\xff\xfe\0",
    "a NUL": b'[record]\nfolder = "a\\u0000b"\n',
    "an escape": b'[record]\nfolder = "\\u001b[2J"\n',
    "an escape in a key": b'"\\u001b[2J" = 1\n',
    "a date that is none": b"seed = 2026-13-77\n",
    "a value of sixty kilobytes": b'rover = "' + b"x" * 60_000 + b'"\n',
}


@pytest.mark.parametrize("name", CONTENTS)
def test_it_is_refused_in_few_printable_words_and_soon(tmp_path: Path, name: str) -> None:
    path = tmp_path / "rover.toml"
    path.write_bytes(CONTENTS[name])
    began_s = time.process_time()
    with pytest.raises(ConfigurationError) as refused:
        load_configuration(path)
    assert time.process_time() - began_s < 5.0
    lines = str(refused.value).split("\n")
    assert len(lines) <= MOST_PROBLEMS + 1
    assert all(line.isprintable() and line.startswith(str(path)) for line in lines)
    assert len(str(refused.value)) < 20_000


def test_what_is_no_file_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero"), Path("a\0b")):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            load_configuration(path)


@pytest.mark.parametrize("value", ["[" * 3000, "9" * 5000, "x" * (LARGEST_BYTES + 1), '"\\u001b"', "{a=" * 3000])
def test_an_override_of_any_kind_is_refused_too(value: str) -> None:
    with pytest.raises(ConfigurationError):
        load_configuration_text("", {"seed": value})
    with pytest.raises(ConfigurationError):
        load_configuration_text("", {"a." * 3000 + "b": "1"})
