"""Configurations that must be refused, made by walking the settings: every key is given what it must not have."""

import math
import random
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import annotated_types
import tomli_w
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from runtime.settings.configuration import Configuration, models_in
from runtime.settings.keys import Table

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Bad:
    """One text. key: full name that the refusal has to say; value: how it shows what stands there, if it stands."""

    kind: str
    text: str
    key: str
    value: str = ""
    hint: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.key} {self.value}"


def fields(table: Table) -> Iterator[tuple[Path, FieldInfo, type[BaseModel] | None]]:
    """Every key below a table, tables included; unions of tables are not gone into."""
    above = tuple(table.path.split(".")) if table.path else ()
    for name, field in table.fields():
        inner = models_in(field.annotation)
        below = inner[0] if len(inner) == 1 and "tuple" not in str(field.annotation) else None
        if not inner or below is not None:
            yield (*above, name), field, below
        if below is not None:
            yield from fields(Table(".".join((*above, name)), "", below))


def text_with(path: Path, value: Any) -> str:
    tree: dict[str, Any] = {}
    table = tree
    for name in path[:-1]:
        table = table.setdefault(name, {})
    table[path[-1]] = value
    return tomli_w.dumps(tree)


def kinds(field: FieldInfo) -> set[type]:
    """The plain types that a field takes."""
    found: set[type] = set()
    waiting = [field.annotation]
    while waiting:
        annotation = waiting.pop()
        if isinstance(annotation, type):
            found.add(annotation)
        waiting += typing.get_args(annotation)
    return found


def wrong_types(path: Path, field: FieldInfo, table: type[BaseModel] | None) -> Iterator[Any]:
    taken = kinds(field)
    if table is not None:
        yield 3
    elif str in taken:
        yield 7
    elif taken & {int, float}:
        yield "many"
        yield True
    elif bool in taken:
        yield "yes"
    if int in taken and float not in taken:
        yield 1.5
    if "tuple" not in str(field.annotation) and "list" not in str(field.annotation):
        yield [[]]


def out_of_range(field: FieldInfo) -> Iterator[Any]:
    if "tuple" in str(field.annotation):
        return
    number = float if float in kinds(field) else int
    for limit in field.metadata:
        if isinstance(limit, annotated_types.Ge):
            yield number(typing.cast(Any, limit.ge) - 1)
        elif isinstance(limit, annotated_types.Gt):
            yield number(typing.cast(Any, limit.gt))
        elif isinstance(limit, annotated_types.Le):
            yield number(typing.cast(Any, limit.le) * 2 + 1)
        elif isinstance(limit, annotated_types.Lt):
            yield number(typing.cast(Any, limit.lt))
    if number is float and float in kinds(field):
        yield from (math.inf, math.nan, 1e-300, 5e-324)


def misspelt(name: str, rng: random.Random) -> str:
    at = rng.randrange(len(name) - 1)
    if len(name) > 4 and name[at] != name[at + 1]:
        return name[:at] + name[at + 1] + name[at] + name[at + 2 :]
    return name + "s"


def generated(rng: random.Random) -> Iterator[Bad]:
    """Wrong types, values out of range and misspelt names, for every key there is."""
    for path, field, table in fields(Table("", "", Configuration)):
        key = ".".join(path)
        for value in wrong_types(path, field, table):
            yield Bad("type", text_with(path, value), key, repr(value))
        for value in out_of_range(field):
            yield Bad("range", text_with(path, value), key, repr(value))
        wrong = (*path[:-1], misspelt(path[-1], rng))
        yield Bad("spelling", text_with(wrong, 1), ".".join(wrong), "1", path[-1])


def broken(whole: str, rng: random.Random) -> Iterator[Bad]:
    """Text that is no TOML: cut off, doubled, with a quote or a bracket too few."""
    lines = whole.splitlines()
    with_value = [number for number, line in enumerate(lines) if "=" in line]
    for number in rng.sample(with_value, min(10, len(with_value))):
        name = lines[number].split("=")[0]
        for wrong in (f"{name}=", f'{name}= "open', f"{name}= [1, 2", f"{lines[number]}\n{lines[number]}", name):
            yield Bad("toml", "\n".join([*lines[:number], wrong, *lines[number + 1 :]]), "not valid TOML")
