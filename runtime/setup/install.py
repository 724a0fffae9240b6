"""The service on a machine: which file goes where, what differs there, and which commands make systemd take it.

Nothing here changes anything before `apply`; a plan can be shown, and applied again without harm.
"""

import difflib
import os
import shutil
import subprocess
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from drivers.canbus.advice import up_command
from drivers.settings.can import BusSettings
from runtime.atomic_write import atomic_write
from runtime.bounded_read import read_bounded
from runtime.errors import ConfigurationError, PreflightError, StorageError
from runtime.settings.configuration import Configuration, load_configuration
from runtime.setup.validation import validate_for_live_run
from runtime.source_tree import CONFIG, SYSTEMD, shipped_configuration

SHIPPED_PROGRAM = Path("/opt/infant/.venv/bin/infant")  # as the units of the repository name it
LARGEST_FILE = 1 << 20  # bytes; a unit has 2 kB, a DBC of a maker 200 kB
CONFIGURATION = "etc/infant/rover.toml"
PLACES = {
    "infant.sysusers": "etc/sysusers.d/infant.conf",
    "infant.tmpfiles": "etc/tmpfiles.d/infant.conf",
    "80-infant-lidar.rules": "etc/udev/rules.d/80-infant-lidar.rules",
    "80-can0.network": "etc/systemd/network/80-can0.network",
    "infant-warmup.service": "etc/systemd/system/infant-warmup.service",
    "infant.service": "etc/systemd/system/infant.service",
}
"""File of systemd/: its place on the rover, below the root."""

Command = tuple[str, ...]
Run = Callable[[Command], None]


class FileState(StrEnum):
    """What a file of the plan is to the file that is there."""

    NEW = "new"
    UNCHANGED = "unchanged"
    DIFFERS = "differs"
    KEPT = "kept"  # it differs, and is the engineer's own
    REMOVED = "removed"
    ABSENT = "absent"


@dataclass(frozen=True, slots=True)
class PlannedFile:
    """One file; diff holds the lines that would change, as `diff -u` shows them."""

    path: Path
    text: str
    state: FileState
    diff: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Plan:
    """All that is done: commands `before`, then the files, then `commands`. notes: what the engineer must know."""

    files: tuple[PlannedFile, ...]
    commands: tuple[Command, ...]
    notes: tuple[str, ...] = ()
    before: tuple[Command, ...] = ()


def plan_install(root: Path, program: Path, configuration: Path | None = None) -> Plan:
    """What `infant install` would do below `root`, with units that start `program`.

    configuration: what becomes /etc/infant/rover.toml where there is none; the repository's own by default.
    Raises ConfigurationError when what will be in force there cannot be used, StorageError when a file cannot be read.
    """
    source = shipped_configuration(configuration or CONFIG / "rover.toml")
    configured = load_configuration(source)
    validate_for_live_run(configured, str(source))
    chosen = _planned(source, root / CONFIGURATION, program, root)
    notes: tuple[str, ...] = ()
    kept = chosen.state is FileState.DIFFERS
    in_force = load_configuration(chosen.path) if kept else configured
    bus = None if in_force.encoders is None else in_force.encoders.bus
    files = tuple(_planned(SYSTEMD / name, root / place, program, root, bus) for name, place in PLACES.items())
    if kept:
        chosen = PlannedFile(chosen.path, chosen.text, FileState.KEPT, chosen.diff)
        validate_for_live_run(in_force, str(chosen.path))
        notes += (f"{chosen.path} is kept: an existing configuration is never overwritten",)
    else:
        files += _layout_file(configured, source, root, program)
    if root == Path("/"):
        live = _live_commands()
        notes += _live_notes(bus)
    else:
        live = ()
        notes += ("the kernels of the filter are compiled before the first start, which takes half a minute",)
        if not (root / program.relative_to("/")).exists():
            notes += (f"the image has no {program} yet; the units start it from there",)
    offline = () if root == Path("/") else (f"--root={root}",)
    commands: tuple[Command, ...] = (
        ("systemd-sysusers", *offline, _name("etc/sysusers.d/infant.conf", root)),
        ("systemd-tmpfiles", *offline, "--create", _name("etc/tmpfiles.d/infant.conf", root)),
        *live,
        ("systemctl", *offline, "enable", "infant.service"),
    )
    return Plan((*files, chosen), commands, notes)


def _layout_file(configuration: Configuration, source: Path, root: Path, program: Path) -> tuple[PlannedFile, ...]:
    """The DBC or EDS that the configuration names, beside it under the same relative name; an absolute one stays.

    Raises ConfigurationError where it would lie outside of the folder, or is no UTF-8 text.
    """
    file = getattr(configuration.encoders and configuration.encoders.layout, "file", None)
    named = Path(tomllib.loads(_text(source))["encoders"]["layout"]["file"]) if file is not None else None
    if file is None or named is None or named.is_absolute():
        return ()
    if ".." in named.parts:
        raise ConfigurationError(f"{source}: encoders.layout.file = {str(named)!r}: put it next to the configuration")
    try:
        planned = _planned(Path(file), (root / CONFIGURATION).parent / named, program, root)
    except StorageError as error:
        raise ConfigurationError(f"{error}; save {file} as UTF-8 text") from error
    kept = planned.state is FileState.DIFFERS
    return (replace(planned, state=FileState.KEPT) if kept else planned,)


def plan_removal(root: Path, program: Path) -> Plan:
    """What `infant install --remove` would do: units and rules go; runs, the user and an edited configuration stay."""
    files = []
    shipped = ((SYSTEMD / name, place) for name, place in PLACES.items())
    for source, place in (*shipped, (CONFIG / "rover.toml", CONFIGURATION)):
        planned = _planned(source, root / place, program, root)
        kept = place == CONFIGURATION and planned.state is FileState.DIFFERS
        state = FileState.KEPT if kept else FileState.REMOVED
        state = FileState.ABSENT if planned.state is FileState.NEW else state
        files.append(PlannedFile(planned.path, planned.text, state))
    notes = ("runs in /var/lib/infant and the user infant stay",)
    if not any(each.path.name == "infant.service" and each.state is FileState.REMOVED for each in files):
        return Plan(tuple(files), (), notes)
    if root != Path("/"):
        return Plan(tuple(files), (), notes, (("systemctl", f"--root={root}", "disable", "infant.service"),))
    stop = (("systemctl", "disable", "--now", "infant.service"), ("systemctl", "stop", "infant-warmup.service"))
    return Plan(tuple(files), (("systemctl", "daemon-reload"),), notes, stop)


def apply(plan: Plan, run: Run) -> None:
    """Do it: `before`, write and remove files, `commands`. Raises StorageError, PreflightError."""
    for command in plan.before:
        run(command)
    for each in plan.files:
        if each.state in (FileState.NEW, FileState.DIFFERS):
            _write(each.path, each.text)
        elif each.state is FileState.REMOVED:
            _remove(each.path)
    for command in plan.commands:
        run(command)


def execute(command: Command) -> None:
    """Run one command of a plan. Raises PreflightError with what it said."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, errors="replace")
    except OSError as error:
        raise PreflightError(f"{' '.join(command)}: {error.strerror}; the service needs systemd") from error
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        why = said[0].rstrip(".") if said else f"exit code {done.returncode}"
        raise PreflightError(f"{' '.join(command)}: {why}; fix that and run infant install again")


def refusal(root: Path, privileged: bool = True) -> str:
    """One sentence on why this process cannot install below `root`, empty if it can; privileged: ask for root too."""
    if root != Path("/"):
        return "" if root.is_dir() else f"--root {root} is not a folder; give the root of an image"
    if shutil.which("systemctl") is None or not Path("/run/systemd/system").is_dir():
        return "this machine was not started by systemd, so there is nothing to install into; use --root for an image"
    if privileged and os.geteuid() != 0:
        return f"installing needs root; run 'sudo {SHIPPED_PROGRAM} install', or --dry-run to see what it would do"
    return ""


def plan_lines(plan: Plan) -> Sequence[str]:
    """The plan for people: a line per file with what would change below it, a line per command."""
    lines = [f"run       {' '.join(command)}" for command in plan.before]
    for each in plan.files:
        lines.append(f"{each.state:10s}{each.path}")
        lines += [f"          {line}" for line in each.diff]
    lines += [f"run       {' '.join(command)}" for command in plan.commands]
    return lines + [f"note      {note}" for note in plan.notes]


def _live_commands() -> tuple[Command, ...]:
    """What a running system needs to take the files; programs that are not there have nothing to be told."""
    commands: list[Command] = [("systemctl", "daemon-reload")]
    if shutil.which("udevadm") is not None:
        commands += [("udevadm", "control", "--reload"), ("udevadm", "trigger", "--subsystem-match=tty")]
    if _is_active("systemd-networkd.service"):
        commands.append(("networkctl", "reload"))
    return (*commands, ("systemctl", "restart", "infant-warmup.service"))


def _live_notes(bus: BusSettings | None) -> tuple[str, ...]:
    notes = []
    if bus is not None and bus.interface == "socketcan" and not _is_active("systemd-networkd.service"):
        notes.append(
            f"systemd-networkd is not active: enable it, or bring {bus.channel} up after each boot: {up_command(bus)}"
        )
    if _is_active("infant.service"):
        notes.append("infant still runs the previous installation; 'systemctl restart infant' starts the new one")
    else:
        notes.append("'systemctl start infant' starts it now; it starts by itself after each boot")
    return tuple(notes)


def _is_active(unit: str) -> bool:
    systemctl = shutil.which("systemctl")
    if systemctl is None:
        return False
    return subprocess.run([systemctl, "is-active", "--quiet", unit], capture_output=True, check=False).returncode == 0


def _planned(source: Path, target: Path, program: Path, root: Path, bus: BusSettings | None = None) -> PlannedFile:
    """One file of the repository against the one in its place. bus: that of the wheels, which a file brings up."""
    _refuse_way_out(root, target)
    text = _text(source).replace(str(SHIPPED_PROGRAM), str(program))
    if bus is not None and bus.interface == "socketcan":
        text = text.replace("Name=can0\n", f"Name={bus.channel}\n").replace(
            "BitRate=500K\n", f"BitRate={bus.bitrate}\n"
        )
    if not target.exists():
        return PlannedFile(target, text, FileState.NEW)
    there = _text(target)
    if there == text:
        return PlannedFile(target, text, FileState.UNCHANGED)
    diff = difflib.unified_diff(there.splitlines(), text.splitlines(), str(target), str(source), n=1, lineterm="")
    return PlannedFile(target, text, FileState.DIFFERS, tuple(diff))


def _refuse_way_out(root: Path, target: Path) -> None:
    """Raises StorageError where links of an image lead to a file of the machine that installs into it."""
    try:
        place = target.resolve()
    except (OSError, RuntimeError) as error:  # links in a circle
        raise StorageError(f"{target} cannot be found ({error}); correct the links of the image") from error
    if not place.is_relative_to(root.resolve()):
        raise StorageError(
            f"{target} leads through a link to {place}, which is not in the image {root}; correct the link"
        )


def _text(path: Path) -> str:
    try:
        return read_bounded(path, LARGEST_FILE).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise StorageError(f"{path} cannot be read ({why}); install infant again") from error


def _write(path: Path, text: str) -> None:
    """Whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, text, mode=0o644)
    except OSError as error:
        raise StorageError(f"{path} cannot be written ({error.strerror}); check the mount") from error


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(f"{path} cannot be removed ({error.strerror}); check the mount") from error


def _name(place: str, root: Path) -> str:
    """How a tool that is told --root names a file below it."""
    return str(Path("/") / place) if root == Path("/") else Path(place).name
