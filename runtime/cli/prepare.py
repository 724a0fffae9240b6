"""Commands before the first drive: setup, config, install."""

import sys
from collections.abc import Callable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar, cast

import typer

from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import AsJson

Value = TypeVar("Value")


def install(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="show every file and command, but change nothing")] = False,
    remove: Annotated[bool, typer.Option("--remove", help="uninstall; runs and configuration stay")] = False,
    config: Annotated[
        Path | None,
        typer.Option("--config", help="configuration to place at /etc/infant/rover.toml if there is none yet"),
    ] = None,
    root: Annotated[Path, typer.Option("--root", help="root folder of an image instead of this machine")] = Path("/"),
    as_json: AsJson = False,
) -> None:
    """Install Infant as a service: user, folders, rules, units, configuration. Needs root."""
    from runtime.errors import PreflightError
    from runtime.setup import install as installation
    from runtime.setup.place import needed_paths, place_trouble, program_path

    root = root.absolute()
    live = root == Path("/")
    program = program_path() if live else installation.SHIPPED_PROGRAM
    trouble = installation.refusal(root, privileged=not dry_run)
    if live and not remove:
        trouble = trouble or place_trouble(program, needed_paths())
    if trouble and not dry_run:
        raise PreflightError(trouble)
    plan = installation.plan_removal(root, program) if remove else installation.plan_install(root, program, config)
    if as_json:
        files = [{"path": str(each.path), "state": each.state} for each in plan.files]
        error = PreflightError(trouble) if trouble else None
        say_json({"files": files, "commands": plan.commands, "notes": plan.notes, "dry_run": dry_run}, error)
    else:
        say(*installation.plan_lines(plan))
    if trouble:
        raise PreflightError(trouble)
    if not dry_run:
        installation.apply(plan, installation.execute)
        if not as_json:
            say("removed" if remove else "installed")


def config(
    defaults: Annotated[bool, typer.Option("--defaults", help="show every key with its default")] = False,
    explain: Annotated[
        str | None,
        typer.Option("--explain", metavar="KEY", help="show what a key or table means, and how to find its value"),
    ] = None,
    diff: Annotated[
        Path | None, typer.Option("--diff", metavar="FILE", help="show what a configuration changes from the defaults")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the keys of the configuration: their defaults, what they mean, and what a file changes."""
    from runtime.errors import UsageError
    from runtime.setup import key_facts

    if sum((defaults, explain is not None, diff is not None)) != 1:
        raise UsageError("give exactly one of --defaults, --explain KEY and --diff FILE")
    if explain is not None:
        facts = key_facts.explained(explain)
        answer({"keys": [fact.as_json() for fact in facts]}, key_facts.explained_lines(facts), as_json)
    elif diff is not None:
        changes = key_facts.changed(diff)
        answer({"config": str(diff), "changed": changes}, key_facts.changed_lines(changes), as_json)
    else:
        facts = key_facts.all_keys()
        answer({"keys": [fact.as_json() for fact in facts]}, key_facts.default_lines(facts), as_json)


GEOMETRY = {
    "--wheel-radius": "radius of a wheel under load, m",
    "--tread": "distance between the points where the two wheels touch the ground, m",
    "--counts-per-rev": "encoder counts for one turn of the wheel, gear included",
    "--laser-ahead": "distance of the laser ahead of the middle of the axle, m; negative if it is behind",
}
"""What nobody can hear on a wire, by option."""


class Side(StrEnum):
    """Of a wheel."""

    LEFT = "left"
    RIGHT = "right"


def setup(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="file to write; never overwritten")] = Path(
        "rover.toml"
    ),
    rover: Annotated[
        str | None, typer.Option("--rover", help="name of the rover; default: that of the machine it runs on")
    ] = None,
    laser: Annotated[
        str | None, typer.Option("--laser", metavar="URL", help="address of the laser; default: search for it")
    ] = None,
    can: Annotated[
        str | None,
        typer.Option("--can", metavar="BUS", help="can0, or INTERFACE:CHANNEL[:PORT]; default: search for it"),
    ] = None,
    dbc: Annotated[
        Path | None,
        typer.Option(
            "--dbc", metavar="FILE", help="DBC of the wheels, from their maker; tried on the frames that are heard"
        ),
    ] = None,
    wheel_radius: Annotated[float | None, typer.Option("--wheel-radius", help=GEOMETRY["--wheel-radius"])] = None,
    tread: Annotated[float | None, typer.Option("--tread", help=GEOMETRY["--tread"])] = None,
    counts_per_rev: Annotated[float | None, typer.Option("--counts-per-rev", help=GEOMETRY["--counts-per-rev"])] = None,
    laser_ahead: Annotated[float | None, typer.Option("--laser-ahead", help=GEOMETRY["--laser-ahead"])] = None,
    backwards: Annotated[bool, typer.Option("--backwards", help="the laser looks backwards")] = False,
    upside_down: Annotated[bool, typer.Option("--upside-down", help="the laser hangs upside down")] = False,
    reverse: Annotated[
        list[Side] | None,
        typer.Option("--reverse", help="wheel whose count falls when the rover drives forward; repeatable"),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="ask nothing: a missing value is an error")] = False,
    as_json: AsJson = False,
) -> None:
    """Find the laser and the wheels and write a configuration for them. On CAN it only listens."""
    from runtime.errors import UsageError
    from runtime.setup.discover.questions import REVERSED, measure, reversed_wheels, yes_or_no
    from runtime.setup.discover.wizard import Known, next_lines, set_up
    from runtime.setup.discover.written import Geometry

    given = dict(zip(GEOMETRY, (wheel_radius, tread, counts_per_rev, laser_ahead), strict=True))
    numbers = {option: measure(option, value) for option, value in given.items() if value is not None}
    missing = [option for option in GEOMETRY if option not in numbers]
    if missing and (yes or not sys.stdin.isatty()):
        wanted = ", ".join(f"{option} ({GEOMETRY[option]})" for option in missing)
        raise UsageError(f"{wanted}: missing; measure, because geometry is never guessed")

    def geometry() -> Geometry:
        facing = (backwards, upside_down)
        falling: tuple[str, ...] = tuple(side for side in Side if side in (reverse or []))
        if missing:
            numbers.update({option: _asked(GEOMETRY[option], partial(measure, option)) for option in missing})
            falling = falling or _asked(REVERSED, reversed_wheels, "")
            questions = ("does the laser look backwards? [y/N]", "does the laser hang upside down? [y/N]")
            facing = (
                backwards or _asked(questions[0], yes_or_no, ""),
                upside_down or _asked(questions[1], yes_or_no, ""),
            )
        radius, width, counts, ahead = (numbers[option] for option in GEOMETRY)
        return Geometry(radius, width, counts, ahead, *facing, falling)

    ask = (lambda question: _asked(question, str)) if missing else None
    try:
        result = set_up(out, rover, Known(laser, can, dbc, ask), geometry, lambda line: say(line, err=as_json))
    except typer.Abort:
        raise KeyboardInterrupt from None
    answer(result.as_json(), next_lines(out), as_json)


def _asked(question: str, taken: Callable[[str], Value], otherwise: str | None = None) -> Value:
    """The first answer that can be used. otherwise: where only Enter is pressed; None: that is no answer.

    Raises typer.Abort where the person has had enough.
    """
    from runtime.errors import UsageError

    def value(text: str) -> Value:
        try:
            return taken(text)
        except UsageError as error:
            raise typer.BadParameter(str(error)) from error

    return cast("Value", typer.prompt(question, otherwise, show_default=False, value_proc=value, err=True))


COMMANDS = (setup, config, install)
