"""The reference of the configuration, made from the models that read it and grouped by what a reader wants to do."""

import json
import typing
from enum import Enum
from types import UnionType
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from runtime.settings.keys import Table, tables

UNITS = {
    "m": "m",
    "s": "s",
    "ms": "ms",
    "hz": "Hz",
    "rad": "rad",
    "deg": "deg",
    "mps": "m/s",
    "radps": "rad/s",
    "gb": "GB",
    "m_per_sqrt_m": "m/√m",
    "rad_per_sqrt_m": "rad/√m",
    "rad_per_sqrt_rad": "rad/√rad",
    "std_per_m": "m/√m",
    "per_metre": "1/m",
    "per_rev": "counts",
    "bytes": "bytes",
    "bitrate": "bit/s",
}
"""What the last part of a key says of its unit."""
BOUNDS = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
TASKS = {
    "Which rover is it, and how does it run?": ("", "loop"),
    "Which sensors do I have?": ("laser", "encoders"),
    "Where is the laser mounted?": ("slam.mount",),
    "Which vehicle is it?": ("vehicle", "slam.odometry"),
    "How is it recorded?": ("record", "data_set"),
    "How is it published and drawn?": ("publish", "review"),
    "Which place is it in?": ("slam.front_end", "slam.view", "slam.quality", "map"),
    "For studies, and without a rover": (
        "slam",
        "slam.techniques",
        "slam.association",
        "slam.gates",
        "slam.joint",
        "slam.front_end.alignment",
        "simulation",
    ),
}
"""Tables by task. A table that is not named goes with the nearest one above it that is."""
HEAD = """# Configuration

A configuration is one TOML file. Every key has a default unless it is *required*, and most files set only a few: start
from a copy of `config/rover.toml`. `infant check --config FILE` says whether a file can be used. A wrong key, type or
value is reported in one sentence with the full name of the key (exit code 3).

- `infant config --explain KEY` shows the same for one key, and `infant config --diff FILE` what a file changes.
- Any key can be changed for one run: `infant run --config FILE --set slam.particles=200`.
- Each run keeps the configuration that was in force, as `config.toml`.

A key is listed here because somebody has a reason to change it. Every other number is a constant in the code, with its
origin next to it.

This page is generated from the models that read the file. Run `make reference` after changing a key.
"""


def configuration_page() -> str:
    """The page, as Markdown: a section for each task, in it one table for each table of the file."""
    found = list(tables())
    return HEAD + "".join(
        f"\n## {task}\n"
        + "".join(_section(table) for table in found if task_of(table.path) == task and not _again(table))
        for task in TASKS
    )


def task_of(path: str) -> str:
    """The task that a table belongs to."""
    while True:
        for task, paths in TASKS.items():
            if path in paths:
                return task
        path = path.rpartition(".")[0]


def _again(table: Table) -> bool:
    """Whether the table is shown already: that of the left wheel holds for the right one."""
    return "right" in table.path.split(".")


def _section(table: Table) -> str:
    rows = [_row(name, field) for name, field in table.leaves()]
    if not rows:
        return ""
    head = "| key | type and range | unit | default | meaning, and how to find the value |\n|---|---|---|---|---|\n"
    return f"\n### {_title(table)}\n\n{_about(table.model)}{head}{''.join(rows)}"


def _title(table: Table) -> str:
    if not table.path:
        return "The top of the file"
    right = table.path.replace(".left", ".right")
    names = f"[{table.path}]" + (f" and [{right}]" if right != table.path else "")
    return names + (f" where kind is {table.kind}" if table.kind else "")


def _about(model: type[BaseModel]) -> str:
    text = (model.__doc__ or "").strip()
    return f"{_escaped(' '.join(text.split()))}\n\n" if text else ""


def _row(name: str, field: FieldInfo) -> str:
    words = ", ".join(fact for fact in (_words(field.annotation), _range(field)) if fact)
    cells = (f"`{name}`", _escaped(words), unit(name), _default(field), _escaped(meaning(name, field)))
    return f"| {' | '.join(cells)} |\n"


def meaning(name: str, field: FieldInfo) -> str:
    """What the key is for and how its value is found; the word that chooses between tables has no text of its own."""
    return field.description or ("chooses this kind of table" if name == "kind" else "")


def unit(name: str) -> str:
    """The unit that a key's name ends with, "" where it has none."""
    parts = name.split("_")
    return next((UNITS[end] for k in range(len(parts)) if (end := "_".join(parts[k:])) in UNITS), "")


def _words(annotation: Any) -> str:
    """A type as a person who writes TOML would call it."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return " or ".join(f"`{str(value).lower() if isinstance(value, bool) else value}`" for value in inner)
    if origin is typing.Annotated:
        return _words(inner[0])
    if origin in (typing.Union, UnionType):
        return " or ".join(_words(each) for each in inner if each is not type(None))
    if origin is tuple and isinstance(inner[0], type) and issubclass(inner[0], BaseModel):
        return "list of tables"
    if origin in (tuple, list):
        return f"list of {_words(inner[0])}"
    if origin is dict:
        return f"table of {_words(inner[1])}"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return " or ".join(f"`{member.value}`" for member in annotation)
    return {float: "number", int: "whole number", bool: "true or false", str: "text"}.get(annotation, str(annotation))


def _range(field: FieldInfo) -> str:
    limits = [*field.metadata, *(each for inner in typing.get_args(field.annotation) for each in _limits(inner))]
    said = [
        f"{sign} {_number(getattr(limit, name))}" for limit in limits for name, sign in BOUNDS if hasattr(limit, name)
    ]
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
    text = _number(value) if isinstance(value, float) else json.dumps(value, default=str, ensure_ascii=False)
    return f"`{text}`"


def _number(value: float) -> str:
    """Six digits are enough for a reader; whole numbers stay whole."""
    return str(value) if isinstance(value, int) else f"{value:.6g}"


def _escaped(text: str) -> str:
    """A bar or a line end would break the table; a bracketed word is no link."""
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "\\<")
