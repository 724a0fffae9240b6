"""What a value should have been, in plain words: pydantic's own speak of arrays, objects and parsing."""

from typing import Any

KINDS = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
    "dict": "a table",
    "model": "a table",
    "finite": "a finite number",
}
"""By the first word of a problem's type."""
PATTERNS = {
    r"^[A-Za-z0-9_-]{1,32}$": "1 to 32 letters, digits, '-' and '_'",
    r"^[a-z0-9_]+$": "lower-case letters, digits and '_'",
    r"^(tcp|udp|tls|quic|ws)/\S+:\d{1,5}(#\S*)?$": "PROTOCOL/HOST:PORT, such as tcp/127.0.0.1:7447",
    r"^(0L|0M|[2-8][0-9]|9[0-7])$": "0L, 0M, or a number from 20 to 97",
}
"""What a regular expression of a setting says to a person."""
BOUNDS = {
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "string_pattern_mismatch": "text that matches {pattern}",
    "string_too_short": "text of at least {min_length} characters",
    "string_too_long": "text of at most {max_length} characters",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
}
"""By the type of the problem; the braces hold what its context has."""


def expected_value(problem: Any) -> str:
    """The words that follow "expected" in a sentence about one problem of a ValidationError."""
    kind = problem["type"]
    if kind == "string_pattern_mismatch" and problem["ctx"]["pattern"] in PATTERNS:
        return PATTERNS[problem["ctx"]["pattern"]]
    if kind in BOUNDS:
        limits = problem["ctx"]
        shown = {name: f"{limit:.15g}" if isinstance(limit, float) else limit for name, limit in limits.items()}
        return (
            BOUNDS[kind].format(**shown).replace(" 1 characters", " one character").replace(" 1 entries", " one entry")
        )
    if kind.endswith(("_type", "_parsing", "_from_float", "_number")):
        return KINDS.get(kind.partition("_")[0], str(problem["msg"]))
    words = str(problem["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
    return words.replace("False, True or", "false, true or")
