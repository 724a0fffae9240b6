"""Signs of life of commands that take longer than a person waits without asking."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer


@contextmanager
def busy(task: str) -> Iterator[None]:
    """A turning sign and the seconds since on standard error, for what has no known end; silent on no terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    terminal = sys.stderr.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not terminal) as progress:
        progress.add_task(task, total=None)
        yield


LONGEST_S = 1e8  # three years: of what is longer nobody waits for the end
AsJson = Annotated[bool, typer.Option("--json", help="print one JSON object on standard output and nothing else")]


def progress_bar(task: str) -> Callable[[float], None]:
    """A bar on standard error that takes the fraction done; silent where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    bar = Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    row = bar.add_task(task, total=1.0)
    bar.start()

    def show(fraction: float) -> None:
        bar.update(row, completed=fraction)
        if fraction >= 1.0:
            bar.stop()

    return show
