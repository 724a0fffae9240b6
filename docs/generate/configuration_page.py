"""The reference of the configuration, made from the models that read it: no key can be forgotten."""

import json
import typing
from collections.abc import Iterator
from enum import Enum
from types import UnionType
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from runtime.settings.configuration import Configuration

UNITS = {
    "m": "m",
    "mm": "mm",
    "s": "s",
    "ms": "ms",
    "us": "µs",
    "ns": "ns",
    "hz": "Hz",
    "rad": "rad",
    "deg": "deg",
    "mps": "m/s",
    "radps": "rad/s",
    "rps": "1/s",
    "gb": "GB",
    "mb": "MB",
    "ppm": "ppm",
    "m2": "m²",
    "rad2": "rad²",
    "m_per_m": "m/m",
    "rad_per_m": "rad/m",
    "rad_per_rad": "rad/rad",
    "mps2": "m/s²",
    "kg": "kg",
    "bps": "bit/s",
}
"""What the last part of a key says of its unit."""
BOUNDS = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
HEAD = """# Configuration

A configuration is one TOML file. Every key has a default unless the table says *required*; `infant check --config FILE`
tells whether a file can be used, and a wrong key, type or value is one sentence with the key's full name (exit code 3).
Any key can be changed for one run: `infant run --config FILE --set slam.particles=200`. The configuration in force is
kept in each run as `config.toml`.

This page is made from the models that read the file (`make docs`).
"""


def configuration_page() -> str:
    """The page, as Markdown: one table for each table of the file."""
    sections = [f"\n## {_title(path, kind)}\n\n{_about(model)}{_table(path, model)}" for path, kind, model in tables()]
    return HEAD + "".join(sections)


def tables() -> Iterator[tuple[str, str, type[BaseModel]]]:
    """Every table of the file, the kind it belongs to where there is a choice of tables ("" elsewhere), its model."""
    yield from _walk("", "", Configuration)


def _walk(path: str, kind: str, model: type[BaseModel]) -> Iterator[tuple[str, str, type[BaseModel]]]:
    kind = _kind(model) or kind
    yield path, kind, model
    for name, field in model.model_fields.items():
        for inner in models_in(field.annotation):
            yield from _walk(f"{path}.{name}".lstrip("."), kind, inner)


def _kind(model: type[BaseModel]) -> str:
    """The word by which the file chooses this model among several."""
    field = model.model_fields.get("kind")
    words = typing.get_args(field.annotation) if field is not None else ()
    return str(words[0]) if len(words) == 1 else ""


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models that a field may hold: none for a value, several for a choice."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in typing.get_args(annotation) for model in models_in(inner)]


def _title(path: str, kind: str) -> str:
    if not path:
        return "The top of the file"
    return f"[{path}]" + (f" where kind is {kind}" if kind else "")


def _about(model: type[BaseModel]) -> str:
    text = (model.__doc__ or "").strip()
    return f"{_escaped(' '.join(text.split()))}\n\n" if text else ""


def _table(path: str, model: type[BaseModel]) -> str:
    rows = [_row(name, field) for name, field in model.model_fields.items() if not models_in(field.annotation)]
    inner = [name for name, field in model.model_fields.items() if models_in(field.annotation)]
    text = ""
    if rows:
        text = "| key | type | unit | range | default | what it is |\n|---|---|---|---|---|---|\n" + "".join(rows)
    if inner:
        names = dict.fromkeys(f"`[{f'{path}.{name}'.lstrip('.')}]`" for name in inner)
        text += f"\nTables below: {', '.join(names)}.\n"
    return text


def _row(name: str, field: FieldInfo) -> str:
    cells = (f"`{name}`", _words(field.annotation), unit(name), _range(field), _default(field), field.description or "")
    return "| " + " | ".join(_escaped(cell) for cell in cells) + " |\n"


def unit(name: str) -> str:
    """The unit that a key's name ends with, "" where it has none."""
    parts = name.split("_")
    return next((UNITS[end] for k in range(1, len(parts)) if (end := "_".join(parts[k:])) in UNITS), "")


def _words(annotation: Any) -> str:
    """A type as a person who writes TOML would call it."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin is typing.Annotated:
        return _words(inner[0])
    if origin in (typing.Union, UnionType):
        return " or ".join(_words(each) for each in inner if each is not type(None))
    if origin in (tuple, list):
        return f"list of {_words(inner[0])}"
    if origin is dict:
        return f"table of {_words(inner[1])}"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " or ".join(f"`{member.value}`" for member in annotation)
    return {float: "number", int: "whole number", bool: "true or false", str: "text"}.get(annotation, str(annotation))


def _range(field: FieldInfo) -> str:
    limits = [*field.metadata, *(each for inner in typing.get_args(field.annotation) for each in _limits(inner))]
    said = [f"{sign} {getattr(limit, name)}" for limit in limits for name, sign in BOUNDS if hasattr(limit, name)]
    for limit in limits:
        said += [f"at least {limit.min_length} long"] if getattr(limit, "min_length", None) else []
        said += [f"matches `{limit.pattern}`"] if getattr(limit, "pattern", None) else []
    return ", ".join(dict.fromkeys(said))


def _limits(annotation: Any) -> list[Any]:
    """Bounds inside Annotated parts of a union, which the field itself does not carry."""
    return list(getattr(annotation, "__metadata__", ()))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "*required*"
    value = field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined:
        return "absent"
    if isinstance(value, BaseModel):
        return ""
    value = value.value if isinstance(value, Enum) else value
    return f"`{json.dumps(value, default=str, ensure_ascii=False)}`"


def _escaped(text: str) -> str:
    """A bar or a line end would break the table; a bracketed word is no link."""
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "\\<")
