"""Text of others made fit for a terminal, a journal or a page: no character of it moves a cursor or begins a line."""


def printable(text: str, longest: int = 4000) -> str:
    """One line, cut at `longest`, in which control and invisible characters stand as escapes such as \\x1b."""
    text = text if len(text) <= longest else f"{text[:longest]} ... ({len(text)} characters)"
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else _escaped(character) for character in text)


def printable_lines(text: str) -> str:
    """The same for a sentence of ours that may have several lines."""
    return "\n".join(map(printable, text.split("\n")))


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()
