"""What commands print: lines for a person, in which no foreign text moves a cursor or begins a line, or one JSON."""

import json
import os
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from itertools import groupby
from typing import Any

import typer

from runtime.errors import InfantError
from runtime.printable import coloured, printable

LONGEST_LINE = 10_000  # characters
MOST_ALIKE = 40  # lines in a row that begin with the same word, such as the marks of a run; the rest is counted

_ANSWERED: ContextVar[bool] = ContextVar("answered", default=False)


def begin_answering() -> None:
    """A new command begins: it has printed no JSON object yet."""
    _ANSWERED.set(False)


def has_answered() -> bool:
    """Whether this command has printed its JSON object: there is only one."""
    return _ANSWERED.get()


def say(*lines: str, err: bool = False) -> None:
    """Print lines; each stays one, and no list fills the terminal: --json has it whole."""
    typer.echo("\n".join(printable(line, LONGEST_LINE) for line in bounded(lines)), err=err)


def say_states(*lines: str) -> None:
    """Lines that name a state, in colour where that is a terminal whose user has nothing against it."""
    shown = [printable(line, LONGEST_LINE) for line in lines]
    typer.echo("\n".join(shown if "NO_COLOR" in os.environ else map(coloured, shown)))  # strips them elsewhere


def bounded(lines: Iterable[str]) -> Iterator[str]:
    """Of each list, that is of lines in a row that begin with the same word, the first ones and how many follow."""
    for word, group in groupby(lines, lambda line: line.partition(" ")[0]):
        alike = list(group)
        is_list = bool(word) and len(alike) > MOST_ALIKE
        yield from alike[:MOST_ALIKE] if is_list else alike
        if is_list:
            yield f"{word:9s} ... and {len(alike) - MOST_ALIKE} more; --json shows all"


def error_object(reason: str, exit_code: int) -> dict[str, Any]:
    """How a program is told why a command failed."""
    return {"error": {"exit_code": exit_code, "reason": reason}}


def say_json(value: Any, error: InfantError | None = None) -> None:
    """Print one JSON object and nothing else. error: with which the command is about to end in spite of its answer."""
    _ANSWERED.set(True)
    if error is not None:
        value = value | error_object(str(error), error.exit_code)
    typer.echo(json.dumps(value).replace("\x7f", "\\u007f"))  # all other control characters JSON escapes itself


def answer(value: Any, lines: Iterable[str], as_json: bool, error: InfantError | None = None) -> None:
    """Print the result of a command in one of its two forms. error: as for say_json."""
    if as_json:
        say_json(value, error)
    else:
        say(*lines)
