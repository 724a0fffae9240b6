"""Commands before the first drive: config, install."""

from pathlib import Path
from typing import Annotated

import typer

from runtime.cli.output import answer, say, say_json
from runtime.cli.progress import AsJson


def install(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="show every file and command, change nothing")] = False,
    remove: Annotated[bool, typer.Option("--remove", help="take it away again; runs and configuration stay")] = False,
    config: Annotated[
        Path | None, typer.Option("--config", help="becomes /etc/infant/rover.toml where there is none yet")
    ] = None,
    root: Annotated[Path, typer.Option("--root", help="root of an image instead of this machine")] = Path("/"),
    as_json: AsJson = False,
) -> None:
    """Install Infant as a service of this machine: user, folders, rules, units, configuration. Needs root."""
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
        say_json({"files": files, "commands": plan.commands, "notes": plan.notes, "dry_run": dry_run})
    else:
        say(*installation.plan_lines(plan))
    if trouble:
        raise PreflightError(trouble)
    if not dry_run:
        installation.apply(plan, installation.execute)
        if not as_json:
            say("removed" if remove else "installed")


def config(
    defaults: Annotated[bool, typer.Option("--defaults", help="every key with its default")] = False,
    explain: Annotated[
        str | None,
        typer.Option("--explain", metavar="KEY", help="what a key or table means, and how to find its value"),
    ] = None,
    diff: Annotated[
        Path | None, typer.Option("--diff", metavar="FILE", help="what a configuration changes from the defaults")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the keys of the configuration: their defaults, what they mean, and what a file changes."""
    from runtime.errors import UsageError
    from runtime.setup import key_facts

    if sum((defaults, explain is not None, diff is not None)) != 1:
        raise UsageError("give one of --defaults, --explain KEY and --diff FILE")
    if explain is not None:
        facts = key_facts.explained(explain)
        answer({"keys": [fact.as_json() for fact in facts]}, key_facts.explained_lines(facts), as_json)
    elif diff is not None:
        changes = key_facts.changed(diff)
        answer({"config": str(diff), "changed": changes}, key_facts.changed_lines(changes), as_json)
    else:
        facts = key_facts.all_keys()
        answer({"keys": [fact.as_json() for fact in facts]}, key_facts.default_lines(facts), as_json)


COMMANDS = (config, install)
