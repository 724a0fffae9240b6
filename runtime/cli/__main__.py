"""The command line: names are fixed, other tools rely on them. Commands import what they need when they run."""

import os
import sys
import traceback
from contextlib import suppress

for stream in (0, 1, 2):  # where one is closed, the next file that is opened would get its number and its output
    with suppress(OSError):
        os.fstat(stream)
        continue
    os.open(os.devnull, os.O_RDWR)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: other thread counts change bits and cost the loop
os.environ.setdefault("RERUN_ANALYTICS", "off")

import typer

from runtime.cli import install, live, log, maps, rover, runs, studies
from runtime.errors import InfantError, StorageError
from runtime.printable import printable, printable_lines

app = typer.Typer(
    name="infant",
    help="The runtime that tells a rover where it is.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for group in (live, install, runs, log, rover, studies):
    for command in group.COMMANDS:
        app.command(command.__name__.rstrip("_"))(command)  # import_ is a word of Python without its underscore
GROUPS = {
    "log": (log.LOG_HELP, log.LOG_COMMANDS),
    "map": (maps.MAP_HELP, maps.MAP_COMMANDS),
    "bridge": (rover.BRIDGE_HELP, rover.BRIDGE_COMMANDS),
}
for name, (text, commands) in GROUPS.items():
    group_app = typer.Typer(name=name, help=text, no_args_is_help=True)
    for command in commands:
        group_app.command()(command)
    app.add_typer(group_app)


def main() -> None:
    """Entry point of the console script; an error of the family ends with its sentence and its exit code.

    Anything else is a defect of ours: its traceback is shown, and the exit code is 70.
    """
    sys.stdout, sys.stderr = (stream or open(os.devnull, "w") for stream in (sys.stdout, sys.stderr))  # noqa: SIM115
    try:
        app()
    except InfantError as error:
        print(f"infant: {printable_lines(str(error))}", file=sys.stderr)
        sys.exit(error.exit_code)
    except OSError as error:  # a file that may not be read, a disk that fails, a terminal that has gone
        where = printable(str(error.filename or "a file"))
        print(f"infant: {where}: {error.strerror or error}; check the file, its disk and the rights", file=sys.stderr)
        sys.exit(StorageError.exit_code)
    except Exception:  # noqa: BLE001 the service manager has to tell a defect from the rest
        traceback.print_exc()
        sys.exit(InfantError.exit_code)


if __name__ == "__main__":
    main()
