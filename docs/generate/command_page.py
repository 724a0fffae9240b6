"""The commands as they describe themselves, and the exit codes as the errors do."""

from collections.abc import Iterator
from typing import Any

import typer

from runtime import errors
from runtime.cli.__main__ import app

WIDTH = 100
HEAD = """# Commands

Names and options are fixed: other tools rely on them. `--json` prints one object on standard output and nothing else
there. `infant --install-completion` teaches the shell to complete them.

This page is generated from the commands themselves (`make reference`).
"""


def command_page() -> str:
    """The page, as Markdown."""
    parts = [f"\n## {name}\n\n```text\n{text.rstrip()}\n```\n" for name, text in helps()]
    return HEAD + "".join(parts) + _exit_codes()


def helps() -> Iterator[tuple[str, str]]:
    """Name and help of every command, groups before their members."""
    for name, command, context in _walk("infant", typer.main.get_command(app), None):
        yield name, command.get_help(context)


def commands() -> Iterator[tuple[str, Any]]:
    """Name and click's object of every command, in the same order."""
    yield from ((name, command) for name, command, _ in _walk("infant", typer.main.get_command(app), None))


def _walk(name: str, command: Any, parent: Any) -> Iterator[tuple[str, Any, Any]]:
    """typer brings a click of its own, so that its types have no name here."""
    context = command.context_class(command, info_name=name.split()[-1], parent=parent, terminal_width=WIDTH)
    yield name, command, context
    for inner, member in getattr(command, "commands", {}).items():
        yield from _walk(f"{name} {inner}", member, context)


def error_classes() -> list[type[errors.InfantError]]:
    """The family, by exit code."""
    found = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, errors.InfantError)]
    return sorted(found, key=lambda each: (each.exit_code == errors.InfantError.exit_code, each.exit_code))


def _exit_codes() -> str:
    rows = "".join(f"| {each.exit_code} | {each.__name__} | {each.__doc__} |\n" for each in error_classes())
    return f"""
## Exit codes

0 is done; 1 is an answer that is no: `replay --verify` found a difference, `review --fail-on` a finding.
The node that `infant bridge rclpy` writes ends with 1 where ROS 2, the package zenoh or the rover is not there.
The others are errors, each with one sentence on standard error; see [troubleshooting](../troubleshooting.md).

| code | error | |
|---|---|---|
{rows}"""
