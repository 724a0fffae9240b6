"""Values in nested tables, as TOML is read, by full names such as slam.odometry.gap_s; and in the text of a file."""

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from runtime.errors import ConfigurationError

Tree = dict[str, Any]
MISSING = object()
HEADER = re.compile(r"\s*\[\s*([^\[\]#]+?)\s*\]\s*(#.*)?")
SMALLEST, LARGEST = 1e-12, 1e12  # magnitudes of a number that somebody may mean; squares and inverses stay finite
IN_FILE, ON_LINE = "in the configuration", "on the command line"  # where a value was given
OLD = r"""([^\s#,}"']+|"[^"\n]*"|'[^'\n]*')"""


def copy_of(tree: Tree) -> Tree:
    """The same tables anew; values are shared."""
    return {key: copy_of(value) if isinstance(value, dict) else value for key, value in tree.items()}


def unusable(tree: Tree, deepest: int, place: str) -> str:
    """Why a tree as it was read cannot hold settings, "" where it can: depth, control characters, numbers of no use.

    place: where it was given and is to be changed, such as "in the configuration".
    """
    waiting: list[tuple[str, Any, int]] = [("", tree, 0)]
    while waiting:
        name, value, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth > deepest:
                return f"{name}: tables or lists in each other more than {deepest} times"
            inner = value.items() if isinstance(value, dict) else enumerate(value)
            waiting += [(f"{name}.{key}".lstrip("."), each, depth + 1) for key, each in inner]
        if any(not character.isprintable() for character in (name, value) if isinstance(character, str)):
            return f"{name} = {value!r}: expected text without control characters; change it {place}"
        if isinstance(value, float) and value != 0.0 and not SMALLEST <= abs(value) <= LARGEST:
            magnitudes = f"0 or a magnitude of {SMALLEST:g} to {LARGEST:g}"
            return f"{name} = {value!r}: expected {magnitudes}; change it {place}"
    return ""


def _tables(tree: Tree, key: str) -> list[Tree]:
    """The tables on the way to a key, as far as they are there."""
    tables = [tree]
    for name in key.split(".")[:-1]:
        inner = tables[-1].get(name)
        if not isinstance(inner, dict):
            break
        tables.append(inner)
    return tables


def value_at(tree: Tree, key: str) -> Any:
    """What stands at a key, or MISSING."""
    names, tables = key.split("."), _tables(tree, key)
    return tables[-1].get(names[-1], MISSING) if len(tables) == len(names) else MISSING


def take(tree: Tree, key: str) -> Any:
    """The value at a key, taken out with the tables below the top that it leaves empty."""
    names, tables = key.split("."), _tables(tree, key)
    if len(tables) < len(names):
        return MISSING
    value = tables[-1].pop(names[-1], MISSING)
    for name, above, table in zip(names[-2::-1], tables[-2::-1], tables[:0:-1], strict=True):
        if value is not MISSING and not table and above is not tree:
            del above[name]
    return value


def put(tree: Tree, key: str, value: Any) -> None:
    """Let a key have this value; tables on the way are made."""
    *tables, last = key.split(".")
    for table in tables:
        tree = tree.setdefault(table, {})
    tree[last] = value


def with_value(text: str, key: str, value: float | bool) -> str:
    """The text in which `key`, a full name, has this value; only its own line differs, or is new.

    Raises ConfigurationError where the file writes the key in a form that cannot be changed safely.
    """
    wanted = _parsed(text)
    put(wanted, key, value)
    for candidate in _candidates(text, key.split("."), str(value).lower() if isinstance(value, bool) else repr(value)):
        if _parsed_or_none(candidate) == wanted:
            return candidate
    raise ConfigurationError(f"{key} is written in a way that cannot be changed safely; give it a line in its table")


def _candidates(text: str, parts: list[str], value: str) -> Iterator[str]:
    """Ways to say it, the most natural first; which of them are right is found by reading them."""
    lines = text.splitlines(keepends=True)
    tables = _tables_of(lines)
    for depth in range(len(parts) - 1, -1, -1):
        path, rest = ".".join(parts[:depth]), parts[depth:]
        mine = [number for number, table in enumerate(tables) if table == path]
        for number in mine:
            yield from _changed(lines, number, rest, value)
    newline = "\r\n" if "\r\n" in text else "\n"
    for depth in range(len(parts) - 1, -1, -1):
        path, line = ".".join(parts[:depth]), f"{'.'.join(parts[depth:])} = {value}{newline}"
        mine = [number for number, table in enumerate(tables) if table == path and lines[number].strip()]
        if mine:
            before, after = lines[: mine[-1] + 1], lines[mine[-1] + 1 :]
            before[-1] = before[-1].rstrip("\r\n") + newline
            yield "".join([*before, line, *after])
        if depth == len(parts) - 1:
            gap = "" if not text else newline if text.endswith("\n") else newline * 2
            yield f"{text}{gap}[{path}]{newline}{line}"


def _changed(lines: list[str], number: int, rest: list[str], value: str) -> Iterator[str]:
    """The text with one line changed: `a.b = old`, or `a = {b = old}`."""
    names = r"\s*\.\s*".join(rf"[\"']?{re.escape(part)}[\"']?" for part in rest)
    patterns = [(rf"^(\s*{names}\s*=\s*){OLD}", rf"\g<1>{value}")]
    if len(rest) > 1:
        first, last = re.escape(rest[0]), re.escape(rest[-1])
        patterns.append((rf"^(\s*{first}\s*=.*?[{{,]\s*{last}\s*=\s*){OLD}", rf"\g<1>{value}"))
        patterns.append((rf"^(\s*{first}\s*=\s*\{{[^#]*?)\s*\}}", rf"\g<1>, {rest[-1]} = {value} }}"))
        patterns.append((rf"^(\s*{first}\s*=\s*)\{{\s*\}}", rf"\g<1>{{ {rest[-1]} = {value} }}"))
    for pattern, replacement in patterns:
        changed, count = re.subn(pattern, replacement, lines[number], count=1)
        if count:
            yield "".join([*lines[:number], changed, *lines[number + 1 :]])


def _tables_of(lines: list[str]) -> list[str]:
    """The table that each line stands in, its own for a header."""
    tables, table = [], ""
    for line in lines:
        match = HEADER.fullmatch(line.rstrip("\r\n"))
        if match:
            table = re.sub(r"""["'\s]""", "", match[1])
        tables.append(table)
    return tables


def _parsed(text: str) -> Tree:
    tree: dict[str, Any] = tomllib.loads(text)
    return tree


def _parsed_or_none(text: str) -> Tree | None:
    try:
        return _parsed(text)
    except tomllib.TOMLDecodeError:
        return None
