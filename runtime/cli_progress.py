"""Signs of life of commands that take longer than a person waits without asking."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


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
