"""The command that speaks to a running rover: infant command."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.output import say, say_json
from runtime.cli.progress import AsJson


class CommandWord(StrEnum):
    """Words of the command line; the same as runtime.commands.Command, which is imported only when it is needed."""

    mark = "mark"
    save = "save"
    stop = "stop"


def command(
    asked: Annotated[CommandWord, typer.Argument(help="mark this moment, save what is recorded, or stop recording")],
    reason: Annotated[str, typer.Argument(help="what was seen; a mark needs one")] = "",
    rover: Annotated[str, typer.Option("--rover", help="its name in the configuration")] = "infant",
    connect: Annotated[str, typer.Option("--connect", help="endpoint of the rover or router")] = "tcp/127.0.0.1:7447",
    zenoh_file: Annotated[
        Path | None, typer.Option("--zenoh", help="zenoh configuration with the certificate, for example for a fleet")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Tell a rover over zenoh to mark, save or stop its recording; it must have publish.commands and access rules."""
    from runtime.commands import Command
    from runtime.errors import UsageError
    from runtime.publish.commands import send_command

    answer = send_command(connect, rover, Command(asked.value), reason, None if zenoh_file is None else str(zenoh_file))
    if as_json:
        said = {"rover": rover, "command": asked.value, "accepted": answer.accepted, "reason": answer.reason}
        say_json(said)
    elif answer.accepted:
        say(f"{rover} accepted {asked.value}; the event stands in its log")
    if not answer.accepted:
        raise UsageError(f"{rover} refused {asked.value}: {answer.reason}")


COMMANDS = (command,)
