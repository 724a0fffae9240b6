"""How `infant --help` reads: commands in groups by what a person wants to do, whole sentences, an example for each."""

import re
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

GROUPS = {
    "Prepare a rover": ("setup", "config", "check", "calibrate", "warmup", "install"),
    "Drive": ("run", "sim", "status", "mark", "command", "bridge", "page"),
    "Look at a run": ("review", "view", "replay", "evaluate", "compare", "import", "smooth", "export", "log", "map"),
    "Study the method": ("paper", "sweep", "quality", "rate", "soak", "bench"),
}
"""Every command in the group of its task; the order is that of the help."""
EXAMPLES = {
    "setup": (
        "infant setup --out my_rover.toml",
        "infant setup --yes --can can0 --wheel-radius 0.1 --tread 0.4 --counts-per-rev 4096 --laser-ahead 0.2",
    ),
    "config": (
        "infant config --defaults",
        "infant config --explain slam.mount.x_m",
        "infant config --diff my_rover.toml",
    ),
    "check": ("infant check --config my_rover.toml --live", "infant check --config mock --json"),
    "calibrate": ("infant calibrate runs/a runs/b --write my_rover.toml",),
    "warmup": ("infant warmup",),
    "install": ("sudo infant install --config my_rover.toml --dry-run", "sudo infant install --config my_rover.toml"),
    "run": ("infant run --config mock --duration 20", "infant run --config my_rover.toml --out runs/yard"),
    "sim": ("infant sim --config mock", "infant sim --laser-only --model UTM-30LX --listen 127.0.0.1:10940"),
    "status": ("infant status --watch", "infant status --json"),
    "mark": ('infant mark "scraped the kerb"',),
    "command": (
        'infant command mark "scraped the kerb" --rover infant',
        "infant command --rover infant initial_pose -- -3.5,2,1.57",
    ),
    "review": ("infant review runs/yard", "infant review runs/yard --fail-on warn --json"),
    "view": ("infant view runs/yard", "infant view --live 192.168.1.20"),
    "replay": ("infant replay runs/yard --verify", "infant replay runs/yard --set slam.particles=200 --out runs/more"),
    "evaluate": ("infant evaluate runs/yard --truth truth.tum",),
    "compare": ("infant compare runs/yard runs/more",),
    "import": ("infant import intel.log --out runs/intel",),
    "smooth": ("infant smooth runs/yard",),
    "export": ("infant export runs/yard --ros2 yard_bag --tum yard.tum",),
    "paper": ("infant paper fig5 --seeds 5 --out paper",),
    "sweep": ("infant sweep runs/yard --set slam.particles=30,100 --out sweep",),
    "quality": ("infant quality --runs 10 --hours 0.5",),
    "rate": ("infant rate --minutes 1",),
    "soak": ("infant soak --minutes 5",),
    "bench": ("infant bench", "infant bench runs/yard"),
    "bridge ros2": ("infant bridge ros2 --domain 7",),
    "bridge foxglove": ("infant bridge foxglove", "infant bridge foxglove --connect 192.168.1.20"),
    "bridge rclpy": ("infant bridge rclpy --out infant_node.py",),
    "page": ("infant page",),
    "log info": ("infant log info runs/yard",),
    "log verify": ("infant log verify runs/yard --json",),
    "log recover": ("infant log recover runs/yard --out runs/rescued",),
    "map save": ("infant map save runs/yard --out yard.map",),
    "map info": ("infant map info yard.map",),
    "map check": ("infant map check yard.map --config mock",),
    "map draw": ("infant map draw runs/yard --out yard",),
    "map merge": ("infant map merge yard.map field.map --out both.map",),
    "map live": ("infant map live --rover mock",),
}
"""Command lines to copy, by command; a test parses each."""


def epilog(name: str) -> str | None:
    """The examples of a command below its help, each on a line of its own; None where it has none."""
    lines = EXAMPLES.get(name, ())
    word = "Example:" if len(lines) == 1 else "Examples:"
    return "\n".join(("\b", word, *(f"  {line}" for line in lines))) if lines else None


TYPES = {"str": "text", "Path": "path", "float": "number", "int": "whole number"}


RANGE = re.compile(r"([-\d.]+)<=x<=([-\d.]+)")
BEYOND = 1e6  # a bound that only keeps nonsense out, and would say nothing to a reader


def plain_ranges(told: str) -> str:
    """A description with its range as a person writes it: `[0.1<=x<=10.0]` is `[0.1 to 10]`."""

    def plain(found: re.Match[str]) -> str:
        least, most = (float(each) for each in found.groups())
        return f"at least {least:g}" if most >= BEYOND else f"{least:g} to {most:g}"

    return RANGE.sub(plain, told)


def plain_type(words: str) -> str:
    """A row of the help with the type of its value as a person calls it: `<list[str]>` is `<text>`."""
    found = re.search(r"<(?:list\[)?([^\[\]<>]+?)\]?( range)?>", words)
    return words if found is None else words.replace(found[0], f"<{TYPES.get(found[1], found[1])}>")


class PlainUsage(TyperCommand):
    """A command whose help names words and types as a person does; typer's own has braces and types of Python."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options."""
        write = formatter.write_dl
        formatter.write_dl = lambda rows: write([(plain_type(words), plain_ranges(told)) for words, told in rows])
        super().format_options(ctx, formatter)
        formatter.write_dl = write

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """The words of the usage line."""
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]


class WholeSentences(TyperGroup):
    """A group whose commands are described in whole sentences; typer's own would cut them."""

    def sections(self, ctx: typer.Context) -> dict[str, tuple[str, ...]]:
        """Names of commands below their title."""
        return {"Commands": tuple(self.list_commands(ctx))}

    def format_commands(self, ctx: typer.Context, formatter: Any) -> None:  # type: ignore[override]
        """Write one list for each section that has commands."""
        for title, names in self.sections(ctx).items():
            found = {name: self.get_command(ctx, name) for name in names}
            rows = [
                (name, first_sentence(command.help or "")) for name, command in found.items() if command is not None
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


class GroupedCommands(WholeSentences):
    """The commands of `infant`, listed by task."""

    def sections(self, ctx: typer.Context) -> dict[str, tuple[str, ...]]:
        """The tasks; what belongs to none of them comes last."""
        grouped = {name for names in GROUPS.values() for name in names}
        return {**GROUPS, "More": tuple(name for name in self.list_commands(ctx) if name not in grouped)}


def first_sentence(text: str) -> str:
    """Up to the first full stop that ends a sentence, without it; a colon or an abbreviation ends none."""
    paragraph = " ".join(text.split("\n\n")[0].split())
    return paragraph.partition(". ")[0].rstrip(".")


def show_version(asked: bool) -> None:
    """Print the version and end."""
    if asked:
        from importlib.metadata import PackageNotFoundError, version

        try:
            typer.echo(f"infant {version('infant')}")
        except PackageNotFoundError:
            typer.echo("infant, run from its sources without being installed")
        raise typer.Exit
