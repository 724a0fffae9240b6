"""Every key that a configuration can have: what the page shows, what is counted, and what tests give wrong values."""

import typing
from collections.abc import Iterator
from typing import NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from runtime.settings.configuration import Configuration, models_in
from runtime.settings.not_keys import NOT_KEYS


class Table(NamedTuple):
    """One table of the file. kind: the choice that it belongs to where there are several models, else ""."""

    path: str
    kind: str
    model: type[BaseModel]

    def fields(self) -> Iterator[tuple[str, FieldInfo]]:
        """Names and fields that a file may set, tables below it included."""
        hidden = NOT_KEYS.get(self.path, frozenset())
        return ((name, field) for name, field in self.model.model_fields.items() if name not in hidden)

    def leaves(self) -> Iterator[tuple[str, FieldInfo]]:
        """Those that hold a value; a list of tables is one, such as that of the faults of a simulated sensor."""
        return ((name, field) for name, field in self.fields() if not _inner(field))


def tables() -> Iterator[Table]:
    """Every table, outer ones first."""
    yield from _below(Table("", "", Configuration))


def distinct_keys() -> set[str]:
    """Full names of all keys; those of the left and the right wheel, which mean the same, once."""
    sides = {"left": "wheel", "right": "wheel"}
    names = set()
    for table in tables():
        path = ".".join(sides.get(part, part) for part in table.path.split("."))
        names |= {f"{path}.{name}".lstrip(".") for name, _ in table.leaves()}
    return names


def _below(table: Table) -> Iterator[Table]:
    yield table
    for name, field in table.fields():
        for model in _inner(field):
            yield from _below(Table(f"{table.path}.{name}".lstrip("."), _kind(model) or table.kind, model))


def _inner(field: FieldInfo) -> list[type[BaseModel]]:
    """The models of the table or tables below, none for a value."""
    return [] if typing.get_origin(field.annotation) is tuple else models_in(field.annotation)


def _kind(model: type[BaseModel]) -> str:
    """The word by which the file chooses this model among several."""
    field = model.model_fields.get("kind")
    words = typing.get_args(field.annotation) if field is not None else ()
    return str(words[0]) if len(words) == 1 else ""
