"""Text of others made fit for a terminal, a journal or a page: no character of it moves a cursor or begins a line."""

import re
from contextlib import suppress
from typing import TextIO

GREEN, YELLOW, RED = 32, 33, 31
STATES = {
    **dict.fromkeys(("PASS", "running", "ready", "fresh"), GREEN),
    **dict.fromkeys(("WARN", "degraded", "starting", "stopping", "stale"), YELLOW),
    **dict.fromkeys(("FAIL", "lost", "failed"), RED),
}
STATE = re.compile(rf"(?<!\S)(?:{'|'.join(STATES)})(?=[\s,:]|$)")


def coloured(line: str) -> str:
    """With the first state that it names in its colour, for a terminal."""
    return STATE.sub(lambda found: f"\x1b[{STATES[found[0]]}m{found[0]}\x1b[0m", line, count=1)


def printable(text: str, longest: int = 4000) -> str:
    """One line, cut at `longest`, in which control and invisible characters stand as escapes such as \\x1b."""
    text = text if len(text) <= longest else f"{text[:longest]} ... ({len(text)} characters)"
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else _escaped(character) for character in text)


def printable_lines(text: str) -> str:
    """The same for a sentence of ours that may have several lines."""
    return "\n".join(map(printable, text.split("\n")))


def tell(stream: TextIO, text: str) -> None:
    """Write to whoever still reads: a terminal or pipe that has gone must not end what goes on without it."""
    with suppress(OSError, ValueError):
        stream.write(text)
        stream.flush()


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()
