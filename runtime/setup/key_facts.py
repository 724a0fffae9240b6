"""What a person asks of a key: what it means, which values it takes, its default, and what a file makes of it."""

import difflib
import json
import tomllib
import typing
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from runtime.errors import UsageError
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.settings.keys import tables

ABSENT = "absent"
OPTIONAL = ("laser", "encoders", "simulation")  # tables that a file may leave out, and whose keys all have defaults
BOUNDS = (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most"))


@dataclass(frozen=True, slots=True)
class KeyFacts:
    """One key. default: None where there is none; required: no default, the file must have it.

    kind: of several kinds of its table the one that has it, else "".
    """

    key: str
    kind: str
    meaning: str
    values: str
    default: Any
    required: bool

    def as_json(self) -> dict[str, Any]:
        """As --json prints it."""
        return asdict(self)


def all_keys() -> list[KeyFacts]:
    """Every key, in the order of the tables."""
    return [
        _facts(f"{table.path}.{name}".lstrip("."), table.kind, field)
        for table in tables()
        for name, field in table.leaves()
    ]


def explained(key: str) -> list[KeyFacts]:
    """The key, or all keys of a table. Raises UsageError for what is neither, with the names that come near."""
    known = all_keys()
    wanted = key.strip("[] ")
    found = [each for each in known if each.key == wanted]
    found = found or [
        each for each in known if each.key.rpartition(".")[0] == wanted or each.key.startswith(f"{wanted}.")
    ]
    if found:
        return found
    tables = {each.key.rpartition(".")[0] for each in known if "." in each.key}
    names = sorted({each.key for each in known} | tables)
    same_end = [name for name in names if name.rpartition(".")[2] == wanted.rpartition(".")[2]]
    close = same_end or difflib.get_close_matches(wanted, names, n=3)
    hint = f"did you mean {' or '.join(close[:3])}?" if close else "see infant config --defaults"
    raise UsageError(f"--explain {key}: no such key; {hint}")


def changed(path: Path) -> dict[str, dict[str, Any]]:
    """What a configuration sets to another value than the default, by key. Raises ConfigurationError."""
    configuration = load_configuration(path)
    tables_there = [name for name in OPTIONAL if getattr(configuration, name) is not None]
    defaults = _flat(load_configuration_text("".join(f"[{name}]\n" for name in tables_there)))
    return {
        key: {"value": value, "default": defaults.get(key)}
        for key, value in sorted(_flat(configuration).items())
        if defaults.get(key) != value
    }


def default_lines(facts: list[KeyFacts]) -> list[str]:
    """Keys with defaults, as TOML would have them with full names."""
    return [f"{each.key} = {_shown(each)}{_of_kind(each)}" for each in facts]


def explained_lines(facts: list[KeyFacts]) -> list[str]:
    """Meaning, values and default of each."""
    lines = []
    for each in facts:
        lines += [f"{each.key}{_of_kind(each)}", f"    {each.meaning or 'chooses this kind of table'}"]
        lines += [f"    values   {each.values}"] if each.values else []
        lines += [f"    default  {_shown(each)}"]
    return lines


def changed_lines(changes: dict[str, dict[str, Any]]) -> list[str]:
    """One line for each key that differs."""
    lines = [f"{key} = {_text(each['value'])}  (default {_text(each['default'])})" for key, each in changes.items()]
    return lines or ["nothing differs from the defaults"]


def _facts(key: str, kind: str, field: FieldInfo) -> KeyFacts:
    default = field.get_default(call_default_factory=True)
    default = None if default is PydanticUndefined else _plain(default)
    return KeyFacts(key, kind, field.description or "", _values(field), default, field.is_required())


def _values(field: FieldInfo) -> str:
    """Words that can be chosen, or bounds."""
    words = [str(word) for word in _words(field.annotation)]
    if words:
        return ", ".join(words)
    limits = [
        f"{said} {getattr(each, name)}" for each in field.metadata for name, said in BOUNDS if hasattr(each, name)
    ]
    return ", ".join(limits)


def _words(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) is typing.Literal:
        return list(typing.get_args(annotation))
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return [member.value for member in annotation]
    return [word for inner in typing.get_args(annotation) for word in _words(inner)]


def _plain(value: Any) -> Any:
    value = value.value if isinstance(value, Enum) else value
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else value


def _flat(configuration: Configuration) -> dict[str, Any]:
    """Values by full key, of the configuration in force."""
    flat: dict[str, Any] = {}

    def walk(tree: dict[str, Any], above: str) -> None:
        for name, value in tree.items():
            if isinstance(value, dict):
                walk(value, f"{above}{name}.")
            else:
                flat[f"{above}{name}"] = value

    walk(tomllib.loads(configuration.text), "")
    return flat


def _of_kind(fact: KeyFacts) -> str:
    return f"  (kind {fact.kind})" if fact.kind else ""


def _shown(fact: KeyFacts) -> str:
    return "required" if fact.required else _text(fact.default)


def _text(value: Any) -> str:
    return ABSENT if value is None else json.dumps(value, ensure_ascii=False, default=str)
