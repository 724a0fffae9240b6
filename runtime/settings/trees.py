"""Values in nested tables, as TOML is read, by full names such as slam.odometry.gap_s."""

from typing import Any

Tree = dict[str, Any]
MISSING = object()


def copy_of(tree: Tree) -> Tree:
    """The same tables anew; values are shared."""
    return {key: copy_of(value) if isinstance(value, dict) else value for key, value in tree.items()}


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
