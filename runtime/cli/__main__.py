"""The command line: names are fixed, other tools rely on them. Commands import what they need when they run."""

import os
import sys
import traceback
import warnings
from contextlib import suppress

for stream in (0, 1, 2):  # where one is closed, the next file that is opened would get its number and its output
    with suppress(OSError):
        os.fstat(stream)
        continue
    os.open(os.devnull, os.O_RDWR)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: other thread counts change bits and cost the loop
os.environ.setdefault("RERUN_ANALYTICS", "off")

from typing import Annotated, Any, NoReturn

import typer

from runtime.cli import live, log, maps, prepare, rover, runs, studies
from runtime.cli.help import GroupedCommands, PlainUsage, WholeSentences, epilog, show_version
from runtime.cli.output import begin_answering, error_object, has_answered, say_json
from runtime.errors import InfantError, Interrupted, StorageError, UsageError
from runtime.printable import printable, printable_lines, tell

app = typer.Typer(
    name="infant",
    cls=GroupedCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (live, prepare, runs, log, rover, studies):
    for command in group.COMMANDS:
        word = command.__name__.rstrip("_")  # import_ is a word of Python without its underscore
        app.command(word, cls=PlainUsage, epilog=epilog(word))(command)
GROUPS = {
    "log": (log.LOG_HELP, log.LOG_COMMANDS),
    "map": (maps.MAP_HELP, maps.MAP_COMMANDS),
    "bridge": (rover.BRIDGE_HELP, rover.BRIDGE_COMMANDS),
}
for name, (text, commands) in GROUPS.items():
    group_app = typer.Typer(name=name, help=text, no_args_is_help=True, cls=WholeSentences)
    for command in commands:
        group_app.command(cls=PlainUsage, epilog=epilog(f"{name} {command.__name__}"))(command)
    app.add_typer(group_app)


INTERRUPTED = Interrupted.exit_code
NOBODY_READS = 141  # the reader of the output has gone, as in `infant ... | head`; as a shell has it


@app.callback()
def infant(
    version: Annotated[
        bool, typer.Option("--version", callback=show_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    """Tell a wheeled rover where it is: from a laser scanner and wheel encoders to a pose with its covariance."""


def main() -> None:
    """Entry point of the console script; an error of the family ends with its sentence and its exit code.

    Anything else is a defect of ours: its traceback is shown, and the exit code is 70.
    """
    sys.stdout, sys.stderr = (stream or open(os.devnull, "w") for stream in (sys.stdout, sys.stderr))  # noqa: SIM115
    as_json = "--json" in sys.argv[1:]
    if not sys.warnoptions:  # numpy warns of a stranger's 1e300, and nobody who reads it can do anything
        warnings.simplefilter("ignore")
    begin_answering()
    try:
        end_of(as_json)
    finally:
        forget_what_nobody_reads()


def end_of(as_json: bool) -> NoReturn:
    """Run the command and end with its exit code."""
    try:
        exit_code = run_command(as_json)
        if as_json and exit_code == INTERRUPTED:
            say_error("interrupted by Ctrl-C", INTERRUPTED)
        sys.exit(exit_code)
    except InfantError as error:
        end(str(error), error.exit_code, as_json)
    except OSError as error:  # a file that may not be read, a disk that fails, a terminal that has gone
        where = printable(str(error.filename or "a file"))
        sentence = f"{where}: {error.strerror or error}; check the file, its disk and its permissions"
        end(sentence, StorageError.exit_code, as_json)
    except Exception as error:  # noqa: BLE001 the service manager has to tell a defect from the rest
        tell(sys.stderr, traceback.format_exc())
        if as_json:
            say_error(f"{type(error).__name__}: {error}", InfantError.exit_code)
        sys.exit(InfantError.exit_code)


def run_command(as_json: bool) -> int:
    """Run the command and return its exit code; words that do not fit show the usage, for a program as UsageError."""
    try:
        result: Any = app(standalone_mode=False)
    except SystemExit as ended:  # typer's, with the exit code 1 that here means "the answer is no"
        if isinstance(ended.__context__, BrokenPipeError):
            return NOBODY_READS
        raise
    except Exception as error:
        if type(error).__name__ == "Abort":  # typer brings a click of its own, whose types have no name here
            return INTERRUPTED
        if not hasattr(error, "format_message"):
            raise
        refused: Any = error
        refused.message = in_plain_words(str(getattr(error, "message", "")))
        if as_json:
            raise UsageError(refused.format_message() or "no command given; see infant --help") from error
        with suppress(OSError):  # whoever reads may have gone
            refused.show()
        return UsageError.exit_code
    return result if isinstance(result, int) else 0


TERMS = {
    "Input should be ": "expected ",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "a valid integer": "a whole number",
    "a valid number": "a number",
}


def in_plain_words(message: str) -> str:
    """What typer says of a word, without the terms of the library that it asks."""
    words = message.removeprefix("Value error, ").partition(", unable to parse")[0]
    for theirs, ours in TERMS.items():
        words = words.replace(theirs, ours)
    return words


def end(sentence: str, exit_code: int, as_json: bool) -> NoReturn:
    """Say why the command ends: a sentence on standard error, and for a program an object on standard output."""
    tell(sys.stderr, f"infant: {printable_lines(sentence)}\n")
    if as_json:
        say_error(sentence, exit_code)
    sys.exit(exit_code)


def forget_what_nobody_reads() -> None:
    """Drop the rest of the output where its reader has gone: Python would complain of it and change the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def say_error(sentence: str, exit_code: int) -> None:
    """One JSON object, unless the command has answered with its own already."""
    if not has_answered():
        with suppress(OSError):  # whoever reads may have gone
            say_json(error_object(sentence, exit_code))


if __name__ == "__main__":
    main()
